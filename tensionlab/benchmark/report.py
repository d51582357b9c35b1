"""Report of a benchmark in Markdown: a row for each entry, a table for each problem set, the machine."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from tensionlab.benchmark.results import COUNTS, NUMBERS, TIMES, Results, entry_names, summary_table
from tensionlab.support.formatting import format_share
from tensionlab.support.table import Column, Table

FIGURES = {
    "profile": "Performance profile: for which share of the problems each entry has an answer to 1e-6 N "
    "within a multiple of the time of the fastest (Dolan and Moré, 2002). Up and left is better.",
    "pareto": "Time and accuracy: typical time of a call, and the largest error of all answers. Down and left is "
    "better.",
}  # captions of the figures that come with the report

SUMMARY = [*TIMES, "worst_s", "solved_1e3", "solved_1e6", "solved_1e9", "elsewhere", "gap_max",
           "iterations_max"]  # columns of the table of all sets  # fmt: skip
IDLE_SHARE = 0.9  # share of the time that a process has the processor, on a machine with nothing else to do
SET_COLUMNS = {
    "solver": Column("solver"),
    "policy": Column("policy"),
    "tried": COUNTS["tried"],
    "verified": Column("verified", format=format_share),
    **{name: column for name, column in NUMBERS.items() if name not in ("prebuilt_s", "own_s")},
    "iterations_max": COUNTS["iterations_max"],
}  # columns of the table of a problem set

HOW_TO_READ = Path(__file__).with_name("how_to_read.md")


def report(results: Results, figures: Collection[str] = tuple(FIGURES)) -> str:
    """Return the report in Markdown, with the named figures of `FIGURES`."""
    about, bench = results.manifest, results.manifest["bench"]
    plan, busy = bench["plan"], bench["processor_share"]
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    warning = ": **the machine was busy, and times are worse than they should be.**" if busy < IDLE_SHARE else "."
    total = sum(about["problems"] for about in results.sets.values())
    parts = [
        "# Tension solvers compared",
        f"{total:,} problems in {len(results.sets)} sets; {results.rows['label'].nunique()} entries.",
        "## All sets",
        "Shares and times are means over the feasible sets, each set counting the same; *other sets* is the "
        "share in the sets that are infeasible or partly so. p99.9 and worst are those of the worst set. † has "
        "another objective.",
        summary_table(results.summary(), SUMMARY, bold=True).to_markdown(),
        *(f"![{name}](figures/{name}.png)\n\n*{caption}*" for name, caption in FIGURES.items() if name in figures),
        "## How to read it",
        HOW_TO_READ.read_text(encoding="utf-8").strip().format(repeats=plan["repeats"], seconds=plan["seconds"]),
        *(_set(results, name) for name in results.sets),
        "## Machine and versions",
        f"- Processor: {about['processor']}; instruction set used: {bench['instruction_set']}; one thread.\n"
        f"- {about['platform']}; Python {about['python']}.\n"
        f"- {versions}.\n"
        f"- Seed {about['seed']}; commit {about['git_commit'] or 'unknown'}; {about['date']}.\n"
        f"- The benchmark had the processor for {format_share(busy)} of the time{warning}\n"
        f"- To repeat: `{about['call']}`",
    ]
    return "\n\n".join(parts) + "\n"


def _set(results: Results, name: str) -> str:
    """Return the section of one problem set: title, groups, a row for each entry, and notes."""
    about = results.sets[name]
    groups = ", ".join(f"{label} ({size})" for label, size in about["groups"])
    rows = results.rows[results.rows["problem_set"] == name]
    tried = rows[rows["tried"] > 0]
    tried = tried.assign(
        solver=entry_names(tried, bold=True),
        policy=tried["policy"].replace("", None),
        verified=(tried["proved"] / tried["tried"]).where(tried["setting"] == "proved"),
        iterations_max=tried["iterations_max"].astype(object).replace(0, None),
    )
    parts = [
        f"## {name}",
        f"{about['title'][0].upper()}{about['title'][1:]}. {groups}. "
        f"The optimum is verified for {min(about['verified'].values()):,} of {about['problems']:,}.",
        Table([*SET_COLUMNS.values()], tried[[*SET_COLUMNS]].values.tolist()).to_markdown(),
    ]
    notes = [
        f"- {row.label}: {row.note}" + (f" ({row.refused:,} of {row.tried:,} problems)" if row.tried else "")
        for row in rows[rows["note"] != ""].itertuples()
    ]
    return "\n\n".join(parts + (["\n".join(notes)] if notes else []))
