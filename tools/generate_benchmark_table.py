"""Table of the benchmark in the documents, from committed results, and the command that commits a run.

``python -m tools.generate_benchmark_table out/bench`` takes the results of a run into the repository;
``make generated`` then writes the table from them.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensionlab.benchmark import results
from tensionlab.benchmark.report import (
    IDLE_SHARE,
    Column,
    calls_table,
    count,
    format_newtons,
    marked,
    summary_table,
)
from tensionlab.benchmark.results import Results
from tensionlab.errors import InputError, TensionlabError
from tensionlab.support.files import writing
from tensionlab.support.formatting import format_duration, format_share

COMMITTED = Path("datasets") / "benchmarks"

COLUMNS: list[Column[Any]] = [
    ("solved to 1e-6 N", lambda line: format_share(line.solved_1e6)),
    ("to 1e-9 N", lambda line: format_share(line.solved_1e9)),
    ("elsewhere", lambda line: format_share(line.elsewhere)),
    ("max gap, N", lambda line: marked(format_newtons(line.gap_max), line.comparable)),
    ("typical call", lambda line: format_duration(line.sgm_s)),
    ("p99.9", lambda line: format_duration(line.p999_s)),
    ("in a batch", lambda line: format_duration(line.batch_s)),
]


def section(found: Results) -> str:
    """Return the paragraph and the table of these results, in Markdown."""
    about = found.manifest
    total = sum(each["problems"] for each in found.sets.values())
    busy = " (which was busy with other work as well)" if about["bench"]["processor_share"] < IDLE_SHARE else ""
    return (
        f"{count(total)} problems in {len(found.sets)} sets on one thread of {about['processor']}"
        f"{busy}, {about['date'][:10]}, tensionlab {about['versions']['tensionlab']}"
        f"{commit_of(about)}: the share of feasible problems solved to an accuracy, *elsewhere* (where "
        "wrenches may be infeasible) to 1e-6 N; the largest difference of a tension to the verified optimum; "
        "the time of one call (verification included for built-in solvers, in bold) and of a problem in a batch. "
        "Baselines solve the plain program, at their defaults and tight; their matrices, such as the identity of "
        "the cost, are built in each call. † has another objective."
        f"\n\n{summary_table(found, COLUMNS)}\n\n{calls_table(found)}"
    )


def commit_of(about: Mapping[str, Any]) -> str:
    """Return the commit of the run in brackets, if that is known."""
    return f" ({about['git_commit'][:7]})" if about["git_commit"] else ""


def commit(run: Path, folder: Path) -> None:
    """Take the results of a run, without the evidence for each problem, into a folder of the repository."""
    found = results.read(run)
    writing.make_folder(folder)
    results.write(folder / results.FILE, found.rows, found.manifest, evidence=False)
    writing.write_text(folder / "manifest.json", json.dumps(found.manifest, indent=2) + "\n")


def main() -> None:
    """Take a run's results into the data sets of the working directory."""
    try:
        if len(sys.argv) != 2:
            raise InputError("name the folder of a run of `tensionlab bench`, such as out/bench")
        commit(Path(sys.argv[1]), COMMITTED)
    except (TensionlabError, OSError) as error:
        print(f"benchmark table: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    print(f"{COMMITTED}: the results of {sys.argv[1]}; now `make checksums`, `make generated` and `make figures`")


if __name__ == "__main__":
    main()
