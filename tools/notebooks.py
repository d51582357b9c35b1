"""Run the notebooks and store what they show, so that it is seen without running them: `make notebooks`.

What is stored is what lasts: times, which are a machine's, are left out, and an output that says the same as the
stored one does not replace it. So a second run changes no file, nor does one on another machine.
"""

from __future__ import annotations

import base64
import copy
import io
import re
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import nbformat
import numpy as np
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LONGEST_S = 600
TIME = re.compile(r"\d[\d.]* (ns|µs|ms)\b")
STYLE = re.compile(r"<style.*?</style>\s*", re.DOTALL)
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]?\d+)?")
MEASURED = "measured"
COLOURS = 128  # of a stored picture, which has flat areas
COARSE = 40  # squares along each side in which two pictures are compared
ALIKE, ROUGHLY = 1e-3, 0.1  # greatest mean difference of two pictures, from 0 to 1; and if they show times
CLOSE = 0.02  # greatest relative difference of two numbers

Shown = Mapping[str, str]  # what one output shows: a text or a picture for each kind


def lasting(kind: str, text: str) -> str | None:
    """Return what is stored of a content of an output, None for nothing."""
    if kind == "image/png":
        return _fewer_colours(text)
    if kind == "text/html":  # of which a code host shows neither styles nor drawings
        return None if "<svg" in text else _without_times(STYLE.sub("", text))
    return text


def _fewer_colours(text: str) -> str:
    picture = Image.open(io.BytesIO(base64.b64decode(text))).convert("RGB")
    file = io.BytesIO()
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


def _without_times(text: str) -> str:
    """Return HTML without the columns of its tables, or the rows of those without a head, that hold times."""
    if not TIME.search(text):
        return text
    root = ElementTree.fromstring(f"<div>{text}</div>")
    for table in root.iter("table"):
        rows = list(table)
        cells = [["".join(cell.itertext()) for cell in row] for row in rows]
        if rows[0].find("th") is None:
            for row, words in zip(rows, cells, strict=True):
                if TIME.search(words[-1]):
                    table.remove(row)
            continue
        for column in reversed(range(len(cells[0]))):
            if any(TIME.fullmatch(words[column]) for words in cells[1:]):
                for row in rows:
                    row.remove(row[column])
    return "".join(ElementTree.tostring(each, encoding="unicode", method="html") for each in root)


def shown(outputs: Sequence[Any]) -> list[Shown]:
    """Return what outputs of a cell show."""
    return [{"stream": each.text} if each.output_type == "stream" else dict(each.data) for each in outputs]


def lasting_outputs(outputs: Sequence[Shown]) -> list[Shown]:
    """Return what is stored of the outputs of a cell: what lasts, and text only where there is nothing better."""
    contents = [{kind: lasting(kind, content) for kind, content in each.items()} for each in outputs]
    lasts = [{kind: content for kind, content in each.items() if content is not None} for each in contents]
    return [{kind: each[kind] for kind in each if len(each) == 1 or kind != "text/plain"} for each in lasts]


def differ(cell: Any, now: Sequence[Shown]) -> str:
    """Return how what a cell shows now differs from what is stored; empty if it says the same.

    Words are the same; numbers to 2 %, whole numbers exactly; pictures but for single pixels. Of a cell with the
    tag `measured`, whose numbers and pictures come from times, words are compared, and pictures roughly.
    """
    one, other = shown(cell.outputs), now
    measured = MEASURED in cell.metadata.get("tags", ())
    kinds = [[sorted(each) for each in outputs] for outputs in (one, other)]
    if kinds[0] != kinds[1]:
        return f"{kinds[0]} and {kinds[1]}"
    for left, right in zip(one, other, strict=True):
        for kind in left:
            if kind == "image/png":
                if (distance := _distance(left[kind], right[kind])) > (ROUGHLY if measured else ALIKE):
                    return f"two pictures, {distance:.4f} apart"
            elif not _same_text(left[kind], right[kind], measured):
                return f"{left[kind]}\nand\n{right[kind]}"
    return ""


def _same_text(one: str, other: str, words_only: bool) -> bool:
    if NUMBER.sub("0", one).split() != NUMBER.sub("0", other).split():
        return False
    return words_only or all(map(_same_number, NUMBER.findall(one), NUMBER.findall(other)))


def _same_number(one: str, other: str) -> bool:
    if one.isdigit() and other.isdigit():
        return one == other
    return abs(float(one) - float(other)) <= max(1e-6, CLOSE * abs(float(one)))


def _distance(one: str, other: str) -> float:
    pictures = [Image.open(io.BytesIO(base64.b64decode(each))).convert("L") for each in (one, other)]
    if not np.allclose(pictures[0].size, pictures[1].size, rtol=ROUGHLY):
        return 1.0
    seen = [np.asarray(each.resize((COARSE, COARSE), Image.Resampling.BOX), dtype=float) for each in pictures]
    return float(np.abs(seen[0] - seen[1]).mean()) / 255.0


def run(notebook: Any) -> None:
    """Run a notebook in an empty folder, and store in it what its cells show."""
    stored = copy.deepcopy(notebook)
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=LONGEST_S, record_timing=False, resources=resources).execute()
    notebook.metadata = stored.metadata
    for cell, before in zip(notebook.cells, stored.cells, strict=True):
        if cell.cell_type == "code":
            now = lasting_outputs(shown(cell.outputs))
            cell.outputs = [_output(each) for each in now] if differ(before, now) else before.outputs
            cell.execution_count = None


def _output(data: Shown) -> Any:
    make: Any = nbformat.v4.new_output
    if "stream" in data:
        return make("stream", name="stdout", text=data["stream"])
    return make("display_data", data=data)


def main() -> None:
    """Run all notebooks, or those named by the beginnings of their names, and say which have changed."""
    for path in [each for each in NOTEBOOKS if each.name.startswith(tuple(sys.argv[1:]) or "")]:
        before = path.read_text(encoding="utf-8")
        notebook = nbformat.reads(before, as_version=4)  # type: ignore[no-untyped-call]
        run(notebook)
        after = nbformat.writes(notebook) + "\n"  # type: ignore[no-untyped-call]
        if after != before:
            path.write_text(after, encoding="utf-8")
        print(f"{path.name}: {len(after) / 1000:.0f} kB{', changed' if after != before else ''}")


if __name__ == "__main__":
    main()
