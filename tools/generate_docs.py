"""Write what is generated into the Markdown files of this repository: `make generated`.

A generated part stands between two lines, ``<!-- NAME: start -->`` and ``<!-- NAME: end -->``, in whichever file.
`BLOCKS` says what makes each: the output of a command, results that are committed, or the code itself. A test
fails while a file says something else.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from kit.parts import bill, measures
from kit.strength import table as loads
from tensionlab import datasets
from tensionlab.errors import TensionlabError
from tensionlab.haptics.bridge.schema import schema_text
from tensionlab.hardware.runner.cycle_table import COLUMNS
from tools.generate_benchmark_table import headline, section
from tools.generate_bridge_docs import SCHEMA_FILE, document
from tools.generate_firmware_docs import sections, table
from tools.generate_solver_choice import choice

ROOT = Path(__file__).parents[1]
# Where Markdown files may hold blocks; those of the first one without its folders.
FOLDERS = (".", "datasets", "docs", "examples", "firmware", "kit", "paper_figures")
MARK = re.compile(
    r"^<!-- (?P<name>[\w-]+): start -->\n(?P<text>.*?)^<!-- (?P<end>[\w-]+): end -->$", re.DOTALL | re.MULTILINE
)
DEMO = ("compare", "bartels2026-validation", "--plot", "out/compare.png")  # what `make demo` runs
LAST_LASTING = "gap"  # columns of the comparison to the right of this one are times, which are a machine's
# Solvers that keep tensions away from both limits.
MID_RANGE = ("pseudoinverse:middle", "closed-form", "safe", "polygon:centroid", "analytic-centre")


def compared() -> str:
    """Return what `make demo` prints, without the times."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "out").mkdir()
        command = [sys.executable, "-m", "tensionlab", *DEMO]
        printed = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout
    return without_times(printed)


def without_times(printed: str) -> str:
    """Return a printed comparison as a block of code, without the columns of times."""
    table, _, legend = printed.partition("\n\n")
    title, head, *rows = table.splitlines()
    width = head.index(LAST_LASTING) + len(LAST_LASTING)
    cut = [line[:width].rstrip() for line in (head, *rows)]
    words = [line for line in legend.splitlines() if not line.startswith(("call:", "batch:"))]
    return "\n".join(["```", title.rstrip(), *cut, "", *words, "```"])


def what_if() -> str:
    """Return a table of what makes the published error, over many simulated rigs."""
    trials = datasets.load("what-if/paper-like-simulated")
    published = datasets.load("published/bartels2026-validation")["value"]
    study = {question: dict(list(rows.groupby("choice"))) for question, rows in trials.groupby("question")}
    sizes = {len(rows) for question in ("solver", "side", "calibration") for rows in study[question].values()}
    stopped = [study["solver alone"][f"dykstra, {count} iterations"] for count in (10, 30, 100)]
    solvers, sides, parts = study["solver"], study["side"], study["calibration"]
    middle = [solvers[name] for name in MID_RANGE]
    rows = [
        ("published", f"{published['angle_mean']:.1f}°",
         f"{published['magnitude_error_mean']:.2f} N (by our reading)"),
        ("simulated, like the published rig", _angle(solvers["newton"]), _vector(solvers["newton"])),
        ("the solver's part: exact solvers", *_pair(study["solver alone"]["newton"])),
        ("the solver's part: Dykstra stopped after 10, 30, 100 iterations",
         ", ".join(f"{each['angle'].median():.2g}°" for each in stopped),
         ", ".join(f"{each['vector'].median():.2f}" for each in stopped) + " N"),
        ("the same rigs, solvers that keep tensions in mid-range",
         _span([each["angle"].median() for each in middle], 0) + "°",
         _span([each["vector"].median() for each in middle], 1) + " N"),
        *((f"a triangle of {side} in place of 1 m", *_pair(sides[side])) for side in ("0.3 m", "0.5 m", "2 m")),
        ("calibrated on half the forces, the other half counted: one gain", *_pair(parts["one gain"])),
        ("gain and bias of each cable", *_pair(parts["gain and bias"])),
        ("a linear map", *_pair(parts["linear map"])),
    ]  # fmt: skip
    head = [("", "mean angle error", "mean length of the error vector"), ("---", "---", "---")]
    shown = "\n".join("| " + " | ".join(row) + " |" for row in (*head, *rows))
    return f"Medians of {', '.join(map(str, sorted(sizes)))} simulated rigs:\n\n{shown}"


def _angle(trials: Any) -> str:
    return f"{trials['angle'].median():.1f}°"


def _vector(trials: Any) -> str:
    return f"{trials['vector'].median():.2f} N"


def _pair(trials: Any) -> tuple[str, str]:
    return _angle(trials), _vector(trials)


def _span(values: Sequence[float], digits: int) -> str:
    """Write from where to where values go, once if that is the same."""
    ends = [f"{end:.{digits}f}" for end in (min(values), max(values))]
    return ends[0] if ends[0] == ends[1] else " to ".join(ends)


def log_columns() -> str:
    """Return the table of what a log has of each cycle."""
    rows = [(f"`{name}`", each.unit, " x ".join(each.dims), each.meaning) for name, each in COLUMNS.items()]
    return table(("Column", "Unit", "Further axes", "Meaning"), rows)


def _measured(make: Callable[[Any], str]) -> Callable[[], str]:
    return lambda: make(datasets.load("benchmarks/results"))


def _table(name: str) -> Callable[[], str]:
    return lambda: _firmware()[name]


@cache
def _firmware() -> dict[str, str]:
    return {name: text for tables in sections().values() for name, text in tables.items()}


BLOCKS: dict[str, Callable[[], str]] = {
    "compare": compared,
    "what-if": what_if,
    **{name: _measured(make) for name, make in (("bench", section), ("headline", headline), ("choice", choice))},
    "log-columns": log_columns,
    "bill": bill,
    "measures": measures,
    "loads": loads,
    **{name: _table(name) for name in _firmware()},
}  # what makes each block, by its name
# What makes each file that is generated as a whole.
FILES: dict[str, Callable[[], str]] = {"docs/reference/bridge.md": document, SCHEMA_FILE: schema_text}


def documents() -> list[Path]:
    """List the Markdown files that may hold blocks."""
    first, *folders = [ROOT / name for name in FOLDERS]
    return sorted([*first.glob("*.md"), *(path for folder in folders for path in folder.rglob("*.md"))])


def blocks(text: str, name: str) -> dict[str, str]:
    """Return what a file has in each of its blocks.

    Raises
    ------
    ValueError
        If a mark has no partner, or nothing makes a block of that name.
    """
    found = list(MARK.finditer(text))
    for match in found:
        if match["name"] != match["end"]:
            raise ValueError(f"{name}: block {match['name']!r} has no end before that of {match['end']!r}")
        if match["name"] not in BLOCKS:
            raise ValueError(f"{name}: nothing makes a block {match['name']!r}; there are {', '.join(BLOCKS)}")
    marks = len(re.findall(r"^<!-- [\w-]+: (?:start|end) -->$", text, re.MULTILINE))
    if marks != 2 * len(found):
        raise ValueError(
            f"{name}: a mark of a block has no partner; each needs a start and an end, on their own lines"
        )
    return {match["name"]: match["text"].strip() for match in found}


def filled(text: str, name: str, make: Callable[[str], str]) -> str:
    """Return a file's text with its blocks made anew.

    Raises
    ------
    ValueError
        As `blocks`.
    """
    blocks(text, name)
    return MARK.sub(
        lambda match: f"<!-- {match['name']}: start -->\n\n{make(match['name'])}\n\n<!-- {match['name']}: end -->",
        text,
    )


def main() -> None:
    """Write all blocks and files, and say which changed."""
    make = cache(lambda name: BLOCKS[name]())
    try:
        made = {path: filled(path.read_text(encoding="utf-8"), path.name, make) for path in documents()}
        made |= {ROOT / name: whole() for name, whole in FILES.items()}
        for path, text in made.items():
            if path.read_text(encoding="utf-8") != text:
                path.write_text(text, encoding="utf-8")
                print(path.relative_to(ROOT))
    except (OSError, ValueError, TensionlabError) as error:
        sys.exit(f"generated: {error}")


if __name__ == "__main__":
    main()
