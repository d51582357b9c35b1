"""Table of the benchmark in the documents, from committed results, and the command that commits a run.

``python -m tools.generate_benchmark_table out/bench`` takes the results of a run into the repository;
``make generated`` then writes the table from them. Where solvers have changed since, the table says so.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tensionlab.benchmark import results
from tensionlab.benchmark.report import IDLE_SHARE
from tensionlab.benchmark.results import TIMES, Results, summary_table
from tensionlab.errors import InputError, TensionlabError
from tensionlab.support.files import writing
from tensionlab.support.formatting import format_duration
from tensionlab.support.table import Column, Table

ROOT = Path(__file__).parents[1]
COMMITTED = Path("datasets") / "benchmarks"

COLUMNS = [*TIMES, "solved_1e6", "solved_1e9", "elsewhere", "gap_max"]
TIMED = (
    "include/**/*.hpp", *(f"tensionlab/native/{room}/*.?pp" for room in ("simd", "solvers", "verification")),
    "tensionlab/native/bindings/allocate.cpp", "tensionlab/native/bindings/single_calls.cpp",
    "tensionlab/allocation.py", "tensionlab/verification.py", "tensionlab/solvers/*.py",
)  # sources of what the benchmark times  # fmt: skip


def section(found: Results) -> str:
    """Return the paragraph and the table of these results, in Markdown."""
    about = found.manifest
    total = sum(each["problems"] for each in found.sets.values())
    busy = " (which was busy with other work as well)" if about["bench"]["processor_share"] < IDLE_SHARE else ""
    return (
        f"{total:,} problems in {len(found.sets)} sets on one thread of {about['processor']} "
        f"({about['bench']['instruction_set']}){busy}, {about['date'][:10]}, "
        f"tensionlab {about['versions']['tensionlab']}{commit_of(about)}{age(about)} Times are of a problem in a "
        "batch; by the clock of a baseline's own compiled code; of a call with the baseline's matrices, such as "
        "the identity of its cost, made beforehand; and of a call as users make it. Built-in solvers, in bold, "
        "clip and verify in every time; baselines solve the plain program, at their defaults and tight. Then come "
        "the share of feasible problems solved to an accuracy, in *other sets* (where wrenches may be infeasible) "
        "to 1e-6 N, and the largest difference of a tension to the verified optimum. † has another objective."
        f"\n\n{summary_table(found.summary(), COLUMNS, bold=True).to_markdown()}"
    )


def headline(found: Results) -> str:
    """Return what the README says of results, in Markdown: the speed of `newton` first, beside DAQP's."""
    summary = found.summary().set_index("label")
    batch, call = (format_duration(summary.loc["newton", name]) for name in ("batch_s", "sgm_s"))
    own, theirs = (format_duration(summary.loc["daqp, default", name]) for name in ("own_s", "sgm_s"))
    old = "" if is_current(found.manifest) else "; solvers have changed since"
    rows = [
        (
            f"{batch} in a batch, {call} a call (DAQP: {own} in C, {theirs} a call){old}",
            "an exact answer with its proof, on [seeded problems](docs/which-solver.md)",
            "`.venv/bin/tensionlab bench --out out/bench`",
        ),
        (
            "10,000 of 10,000",
            "answers of the playground equal to Python's",
            "`.venv/bin/pytest tests/playground`",
        ),
        (
            "0 contradictions",
            "between [workspace proofs](docs/how-to/analyse-a-workspace.md) and linear programs",
            "`.venv/bin/pytest tests/workspace/certification`",
        ),
    ]
    return Table([Column("result"), Column("meaning"), Column("command")], rows).to_markdown()


def commit_of(about: Mapping[str, Any]) -> str:
    """Return the commit of the run in brackets, if that is known."""
    return f" ({about['git_commit'][:7]})" if about["git_commit"] else ""


def age(about: Mapping[str, Any]) -> str:
    """End the sentence about a run; add one where solvers or kernels have changed since it was committed."""
    return "." if is_current(about) else ". **Solvers or kernels have changed since then.**"


def is_current(about: Mapping[str, Any]) -> bool:
    """Tell whether a run was committed with the solvers and kernels that there are."""
    return bool(about["bench"].get("sources") == sources())


def sources() -> str:
    """Return the SHA-256 digest of the sources of what the benchmark times."""
    digest = hashlib.sha256()
    for path in sorted(path for pattern in TIMED for path in ROOT.glob(pattern) if path.is_file()):
        digest.update(f"{path.relative_to(ROOT).as_posix()}\n".encode() + path.read_bytes())
    return digest.hexdigest()


def commit(run: Path, folder: Path) -> None:
    """Take the results of a run, without the measurements of each problem, into a folder of the repository."""
    found = results.read(run)
    found.manifest["bench"]["sources"] = sources()
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
