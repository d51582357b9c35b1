"""Table of the benchmark in the documents, from committed results, and the command that commits a run.

``python -m tools.generate_benchmark_table out/bench`` takes the results of a run into the repository;
``make generated`` then writes the table from them.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensionlab.benchmark import results
from tensionlab.benchmark.report import IDLE_SHARE
from tensionlab.benchmark.results import Results, summary_table
from tensionlab.errors import InputError, TensionlabError
from tensionlab.support.files import writing

COMMITTED = Path("datasets") / "benchmarks"

COLUMNS = ["solved_1e6", "solved_1e9", "elsewhere", "gap_max", "sgm_s", "p999_s", "batch_s"]


def section(found: Results) -> str:
    """Return the paragraph and the table of these results, in Markdown."""
    about = found.manifest
    total = sum(each["problems"] for each in found.sets.values())
    busy = " (which was busy with other work as well)" if about["bench"]["processor_share"] < IDLE_SHARE else ""
    return (
        f"{total:,} problems in {len(found.sets)} sets on one thread of {about['processor']}"
        f"{busy}, {about['date'][:10]}, tensionlab {about['versions']['tensionlab']}"
        f"{commit_of(about)}: the share of feasible problems solved to an accuracy, in *other sets* (where "
        "wrenches may be infeasible) to 1e-6 N; the largest difference of a tension to the verified optimum; "
        "the time of one call (verification included for built-in solvers, in bold) and of a problem in a batch. "
        "Baselines solve the plain program, at their defaults and tight; their matrices, such as the identity of "
        "the cost, are built in each call. † has another objective."
        f"\n\n{summary_table(found.summary(), COLUMNS, bold=True).to_markdown()}"
    )


def commit_of(about: Mapping[str, Any]) -> str:
    """Return the commit of the run in brackets, if that is known."""
    return f" ({about['git_commit'][:7]})" if about["git_commit"] else ""


def commit(run: Path, folder: Path) -> None:
    """Take the results of a run, without the measurements of each problem, into a folder of the repository."""
    found = results.read(run)
    writing.make_folder(folder)
    results.write(folder, results.Results(found.rows, found.manifest))


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
