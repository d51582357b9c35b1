"""Report of a benchmark in Markdown, written from its results: one line an entry, one table a problem set."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from typing import Any, TypeVar

from tensionlab.benchmark.results import EntryResult, Results, summaries
from tensionlab.benchmark.speed import PASSES
from tensionlab.support.formatting import format_duration, format_share

Of = TypeVar("Of")


def format_newtons(value: float) -> str:
    """Write a force in N with two digits, small ones as powers of ten."""
    if math.isnan(value):
        return "–"
    if value == 0:
        return "0"
    if 0.01 <= abs(value) < 1e4:
        return f"{value:.2g}" if abs(value) < 10 else f"{value:.0f}"
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def times(ratio: float) -> str:
    """Write a ratio with two digits."""
    return "–" if math.isnan(ratio) else f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"


def count(number: int) -> str:
    """Write a number with commas between thousands."""
    return f"{number:,}"


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Make a table in Markdown; the first ``left`` columns to the left, the others to the right."""
    rules = [":--" if column < left else "--:" for column in range(len(headings))]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (headings, rules, *rows))


FIGURES = {
    "profile": "Performance profile: for which share of the problems each entry has an answer to 1e-6 N "
    "within a multiple of the time of the fastest (Dolan and Moré, 2002). Up and left is better.",
    "pareto": "Time and accuracy: typical time of a call, and the largest error of all answers. Down and left is "
    "better.",
    "worst": "The worst case: median, 99.9 % quantile and worst time of a call, of all feasible sets.",
    "continuity": "Along one trajectory sampled at 1 kHz: the tensions of all cables, by solver.",
}  # captions of the figures that come with the report

# Share of the time that the benchmark's process has the processor, on a machine with nothing else to do.
IDLE_SHARE = 0.9

Column = tuple[str, Callable[[Of], str]]  # heading, and the text of a cell
SUMMARY_COLUMNS: list[Column[Any]] = [
    ("1e-3 N", lambda line: format_share(line.solved_1e3)),
    ("1e-6 N", lambda line: format_share(line.solved_1e6)),
    ("1e-9 N", lambda line: format_share(line.solved_1e9)),
    ("elsewhere 1e-6 N", lambda line: format_share(line.elsewhere)),
    ("max gap, N", lambda line: marked(format_newtons(line.gap_max), line.comparable)),
    ("typical call", lambda line: format_duration(line.sgm_s)),
    ("prebuilt", lambda line: format_duration(line.prebuilt_s)),
    ("p99.9", lambda line: format_duration(line.p999_s)),
    ("worst", lambda line: format_duration(line.worst_s)),
    ("in a batch", lambda line: format_duration(line.batch_s)),
    ("iterations", lambda line: count(line.iterations_max) if line.iterations_max else "–"),
]
ROW_COLUMNS: list[Column[EntryResult]] = [
    ("tried", lambda row: count(row.tried)),
    ("verified", lambda row: format_share(row.proved / row.tried) if row.setting == "proved" else "–"),
    ("1e-3 N", lambda row: format_share(row.solved_1e3)),
    ("1e-6 N", lambda row: format_share(row.solved_1e6)),
    ("1e-9 N", lambda row: format_share(row.solved_1e9)),
    ("error, N", lambda row: format_newtons(row.error_max)),
    ("limits, N", lambda row: format_newtons(row.violation_max)),
    ("gap median", lambda row: marked(format_newtons(row.gap_median), row.comparable)),
    ("gap max, N", lambda row: marked(format_newtons(row.gap_max), row.comparable)),
    ("typical", lambda row: format_duration(row.sgm_s)),
    ("median", lambda row: format_duration(row.median_s)),
    ("p99", lambda row: format_duration(row.p99_s)),
    ("p99.9", lambda row: format_duration(row.p999_s)),
    ("worst", lambda row: format_duration(row.worst_s)),
    ("build", lambda row: format_duration(row.build_s)),
    ("set-up", lambda row: format_duration(row.setup_s)),
    ("solve", lambda row: format_duration(row.solve_s)),
    ("batch", lambda row: format_duration(row.batch_s)),
    ("iterations", lambda row: count(row.iterations_max) if row.iterations_max else "–"),
]

HOW_TO_READ = """\
- **Every problem** is to find the tensions of least `|t|²` that render a wrench inside their limits. A solver
  with another objective (†) is compared by feasibility, speed and continuity; its gap is a difference of
  objectives.
- **Built-in solvers** run through the interface: a prepared `tl.Allocator`, the time of clipping and verifying
  included. **Baselines** solve the plain program, *default* with their own settings and *tight* with the
  strictest that make sense; nothing is verified in their time.
  `daqp` is its own Python module; `qpsolvers:…` goes through qpsolvers; `cvxpy` fills numbers into a
  program that it compiled once.
- **1e-3, 1e-6, 1e-9 N**: the share of the problems solved so accurately: the wrench (of the tensions
  clipped into their limits) as near as it can be, and the raw tensions outside their limits by no more;
  times the norm of the wrench where that is above 1 N. For an infeasible wrench, "near" is as the policy has it
  (the closest wrench for a solver without one), and the least possible error is subtracted. Refused problems
  are not solved.
- **gap**: largest difference of a tension to the optimum. The optimum comes from the exact solver and is
  verified by its duality gap, which anyone can compute; problems where that proof fails are left out of the
  gap.
- **error** and **limits**: the largest error above the least possible, and the largest violation of a limit
  by a raw answer.
- **Times** are of one call from arrays to tensions, each problem the best of {repeats} in random order, in
  blocks in which the entries take turns; so they are the solver's and not the machine's. *typical* is
  the shifted geometric mean (shift 1 µs). *build* is the part that brings the arrays into the baseline's form,
  such as the identity matrix of its cost; *prebuilt* is the typical call without it, as in a loop that keeps
  them; *set-up* and *solve* are by the baseline's own clock, where it has one. *batch*: a problem in one large
  batch.
- **tried**: each entry has {seconds:g} s for each set; one that needs longer gets fewer of the
  problems, drawn at random."""


def report(results: Results, figures: Collection[str] = tuple(FIGURES)) -> str:
    """Return the report in Markdown, with the named figures of `FIGURES`."""
    plan = results.manifest["bench"]["plan"]
    total = sum(about["problems"] for about in results.sets.values())
    parts = [
        "# Tension solvers compared",
        f"{count(total)} problems in {len(results.sets)} sets; {count(len(summaries(results)))} entries.",
        "## All sets",
        "Shares and times are means over the feasible sets, each set counting the same; *elsewhere* is the "
        "share in the sets that are infeasible or partly so. p99.9 and worst are those of the worst set. † has "
        "another objective.",
        summary_table(results),
        *(f"![{name}](figures/{name}.png)\n\n*{caption}*" for name, caption in FIGURES.items() if name in figures),
        "## How to read it",
        HOW_TO_READ.format(repeats=plan["repeats"], seconds=plan["seconds"]),
        *(_set(results, name) for name in results.sets),
        *_batches(results),
        "## Machine and versions",
        _machine(results),
    ]
    return "\n\n".join(parts) + "\n"


def marked(text: str, comparable: bool) -> str:
    """Return the text, with a dagger where the objective is another one."""
    return text if comparable or text == "–" else f"{text} †"


def summary_table(results: Results, columns: Sequence[Column[Any]] = SUMMARY_COLUMNS) -> str:
    """Return a table of all entries over all sets; those that did not take part last, with the reason."""
    rows = []
    for line in summaries(results):
        name = marked(f"**{line.label}**" if line.built_in else line.label, line.comparable)
        cells = [line.note, *[""] * (len(columns) - 1)] if line.absent else [write(line) for _, write in columns]
        rows.append([name, *cells])
    return table(["solver", *(heading for heading, _ in columns)], rows)


def _set(results: Results, name: str) -> str:
    """Return the section of one problem set: title, groups, a row each entry, and what was refused."""
    about, rows = results.sets[name], results.of_set(name)
    groups = ", ".join(f"{label} ({size})" for label, size in about["groups"])
    verified = min(about["verified"].values())
    cells, notes = [], []
    for row in rows:
        label = marked(f"**{row.label}**" if row.setting == "proved" else row.label, row.comparable)
        if row.tried:
            cells.append([label, row.policy or "–", *(write(row) for _, write in ROW_COLUMNS)])
        else:
            cells.append([label, row.policy or "–", row.note or "–", *[""] * (len(ROW_COLUMNS) - 1)])
        if row.tried and row.note:
            notes.append(f"- {row.label}: {row.note} ({count(row.refused)} of {count(row.tried)} problems)")
    parts = [
        f"## {name}",
        f"{about['title'][0].upper()}{about['title'][1:]}. {groups}. "
        f"The optimum is verified for {count(verified)} of {count(about['problems'])}.",
        table(["solver", "policy", *(heading for heading, _ in ROW_COLUMNS)], cells, left=2),
    ]
    return "\n\n".join(parts + (["\n".join(notes)] if notes else []))


def _batches(results: Results) -> list[str]:
    """Return the section of the exact solver's batches and single calls; nothing where they were left out."""
    if not results.batches:
        return []
    rows = [
        [
            f"n = {row.components}, m = {row.cables}",
            "feasible" if row.reachable else "infeasible",
            format_duration(row.one_core_s),
            format_duration(row.all_cores_s),
            format_duration(row.daqp_c_s),
            format_duration(row.daqp_loop_s),
            f"{row.ratio:.3f}",
            times(row.daqp_loop_s / row.all_cores_s),
            format_newtons(row.gap_max),
        ]
        for row in results.batches
    ]
    first = results.batches[0]
    headings = ["", "wrenches", "one core", f"all {first.cores} cores", "DAQP in C", "loop over DAQP",
                "one core / DAQP in C", "loop / all cores", "max gap, N"]  # fmt: skip
    return [
        "## Batches",
        f"{count(first.count)} random problems in one `tl.allocate` call, verification included: time for each. "
        "DAQP's time in C is set-up plus solve by its own clock; the loop calls its Python module with all arrays "
        "ready. Each the best of its rounds.",
        table(headings, rows, left=2),
        calls_table(results),
    ]


def calls_table(results: Results) -> str:
    """Return what single calls take, of solvers and baselines in turn, with a sentence on what the columns are."""
    rows = [
        [
            f"n = {call.components}, m = {call.cables}",
            f"`{call.caller}`",
            format_duration(call.median_s),
            format_duration(call.p999_s),
            times(call.p999_s / call.median_s),
            times(call.quiet_p999_s / call.median_s),
        ]
        for call in results.calls
    ]
    about = (
        "One call for one problem, the callers in turn. Whatever interrupts the process counts in p99.9, but "
        f"hardly in the last column, where each problem has its best time of {PASSES}:"
    )
    return (
        f"{about}\n\n{table(['', 'caller', 'median', 'p99.9', 'p99.9 / median', 'uninterrupted'], rows, left=2)}"
    )


def _machine(results: Results) -> str:
    """Return the list of what is known of the machine and of the run."""
    about, bench = results.manifest, results.manifest["bench"]
    busy = bench["processor_share"]
    lines = [
        f"- Processor: {about['processor']}; instruction set used: {bench['instruction_set']}; one thread, but "
        "for the batches on all cores.",
        f"- {about['platform']}; Python {about['python']}.",
        "- " + ", ".join(f"{name} {version}" for name, version in about["versions"].items()) + ".",
        f"- Seed {about['seed']}; commit {about['git_commit'] or 'unknown'}; {about['date']}.",
        f"- The benchmark had the processor for {format_share(busy)} of the time"
        + ("." if busy >= IDLE_SHARE else ": **the machine was busy, and times are worse than they should be.**"),
        f"- To repeat: `{about['call']}`",
    ]
    return "\n".join(lines)
