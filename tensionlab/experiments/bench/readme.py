"""The comparison in the README, filled in from committed results: `python -m tensionlab.experiments.bench.readme`.

With the folder of a run as its argument, `python -m tensionlab.experiments.bench.readme out/bench` first takes
that run's results into the repository. A test fails if the README and the committed results differ.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

from tensionlab import writing
from tensionlab.errors import ShapeError, TensionlabError
from tensionlab.experiments.bench import results
from tensionlab.experiments.bench.findings import findings
from tensionlab.experiments.bench.headline import Headline, headlines
from tensionlab.experiments.bench.report import IDLE, marked
from tensionlab.experiments.bench.results import Results
from tensionlab.experiments.bench.text import count, duration, newton, percent, table

START, END = "<!-- bench: start -->", "<!-- bench: end -->"
"""What is between these lines in the README is written here."""
COMMITTED = Path("datasets") / "benchmarks"

COLUMNS: list[tuple[str, Callable[[Headline], str]]] = [
    ("solved to 1e-6 N", lambda line: percent(line.solved_1e6)),
    ("to 1e-9 N", lambda line: percent(line.solved_1e9)),
    ("elsewhere", lambda line: percent(line.elsewhere)),
    ("largest gap, N", lambda line: marked(newton(line.gap_max), line.comparable)),
    ("typical call", lambda line: duration(line.sgm_s)),
    ("p99.9", lambda line: duration(line.p999_s)),
    ("in a batch", lambda line: duration(line.batch_s)),
]


def section(found: Results) -> str:
    """What does the README say about these results?"""
    rows = []
    for line in headlines(found):
        name = marked(f"**{line.label}**" if line.house else line.label, line.comparable)
        absent = line.note and line.sgm_s != line.sgm_s
        cells = [line.note, *[""] * (len(COLUMNS) - 1)] if absent else [write(line) for _, write in COLUMNS]
        rows.append([name, *cells])
    about = found.manifest
    total = sum(each["problems"] for each in found.sets.values())
    busy = " (which was busy with other work as well)" if found.manifest["bench"]["processor_share"] < IDLE else ""
    return "\n\n".join(
        [
            f"{count(total)} problems in {len(found.sets)} sets on one thread of {about['processor']}"
            f"{busy}, {about['date'][:10]}: the share solved within reach to an accuracy, *elsewhere* (where "
            "wrenches may be out of reach) to 1e-6 N; the largest difference of a tension to the proved optimum; "
            "the time of one call (proof included for solvers of the house, in bold) and of a problem in a batch. "
            "Peers solve the plain program, at their defaults and tight. † has another objective.",
            table(["solver", *(heading for heading, _ in COLUMNS)], rows),
            "\n".join(f"- {finding}" for finding in findings(found)),
        ]
    )


def filled(readme: str, found: Results) -> str:
    """The README with its section as these results have it.

    Raises
    ------
    ShapeError
        If the README has no such section.
    """
    before, start, rest = readme.partition(START)
    _, end, after = rest.partition(END)
    if not (start and end):
        raise ShapeError(f"README.md: no section between the lines {START} and {END}")
    return f"{before}{START}\n\n{section(found)}\n\n{END}{after}"


def commit(run: Path, folder: Path) -> None:
    """Take the results of a run, without the evidence for each problem, into a folder of the repository."""
    found = results.read(run)
    writing.make_folder(folder)
    results.write(folder / results.FILE, found.rows, found.manifest, evidence=False)
    writing.write_text(folder / "manifest.json", json.dumps(found.manifest, indent=2) + "\n")


def main() -> None:
    """Fill the README of the working directory, from a new run if one is named."""
    try:
        if len(sys.argv) > 1:
            commit(Path(sys.argv[1]), COMMITTED)
        readme = Path("README.md")
        writing.write_text(readme, filled(readme.read_text(encoding="utf-8"), results.read(COMMITTED)))
    except (TensionlabError, OSError) as error:
        print(f"readme: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    print(f"README.md: filled from {COMMITTED}")


if __name__ == "__main__":
    main()
