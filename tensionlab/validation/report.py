"""The measured numbers beside the published ones, line by line, for people, programs and papers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, NamedTuple

from tensionlab.validation.results import TILTED, Result
from tensionlab.validation.statistics import Interval

SOURCE = "Bartels et al. 2026, arXiv 2603.08054"
READING = (
    '"Magnitude error" is not defined in the publication. Read as the length of the error vector, |F - F0|, its '
    "0.58 N fit its other numbers; read as the difference of the magnitudes, they do not. That the first is meant "
    "is our inference."
)
GRID = (
    "The publication gives the number of vectors, 182; that they are a grid of 18 degrees with its poles on the "
    "vertical is our inference too. 42 of them lie within 18 degrees of a pole, so plain means count the pole "
    "axis too much: the column weighted by sin(theta) is the mean over the sphere."
)


class Line(NamedTuple):
    """One number of the comparison; `weighted` and `largest` may be missing."""

    name: str
    unit: str
    published: float
    measured: Interval
    weighted: Interval | None
    largest: float | None


def lines(result: Result) -> list[Line]:
    """Which numbers are compared? Forces are aligned as published."""
    score = result.aligned["paper"].score
    angle, magnitude = score.angle, score.magnitude
    within = Interval(100.0 * score.within, float("nan"), float("nan"))
    scalar, vector = score.magnitude_error, score.vector
    return [
        Line("mean angle error", "degrees", 14.0, angle.mean, angle.weighted, angle.largest),
        Line("vectors within 45 degrees", "%", 100.0, within, None, None),
        Line("mean magnitude", "N", 1.84, magnitude.mean, magnitude.weighted, magnitude.largest),
        Line('"magnitude error", as | |F| - |F0| |', "N", 0.58, scalar.mean, scalar.weighted, scalar.largest),
        Line('"magnitude error", as |F - F0|', "N", 0.58, vector.mean, vector.weighted, vector.largest),
    ]


def remarks(result: Result) -> list[str]:
    """What must be known to read the numbers, a sentence or two each?"""
    setup = result.setup
    count = len(result.desired)
    window = f"from {setup['settle']:g} to {setup['hold']:g} s of each force"
    found = [READING, GRID, f"Averages are {window}: what comes before is left out, while tensions move."]
    if setup["simulated"]:
        which = f"preset {setup['preset']}, seed {setup['seed']}" if setup["preset"] else "in another process"
        found.insert(0, f"These modules are simulated: {which}.")
    if result.exact < count:
        found.append(
            f"{result.exact} of {count} forces are within the reach of the rig; of the others, the nearest was "
            "rendered."
        )
    if result.replaced:
        found.append(
            f"In {result.replaced} of {count} forces {setup['solver']} left its answer unproved, so that newton's "
            "was sent: these numbers are not all its own."
        )
    if result.tilt > TILTED:
        found.append(
            f"The best rotation (Kabsch) differs from the published alignment by {result.tilt:.1f} degrees: the "
            "sensor leans, or the forces on the axes are off; a turn about the vertical leaves that in the errors."
        )
    if result.rested:
        found.append(f"Modules had to rest for {result.rested:.0f} s in all, so that windings could cool.")
    for name, times in result.hindered.items():
        found.append(f"Module {name} was kept from pulling as it was told at {times} forces.")
    return found


def as_json(result: Result, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """The whole report, for programs."""
    return {
        "manifest": dict(manifest),
        "simulated": result.setup["simulated"],
        "setup": {key: value for key, value in result.setup.items() if key != "directions"},
        "vectors": len(result.desired),
        "exact": result.exact,
        "replaced": result.replaced,
        "rested": result.rested,
        "source": SOURCE,
        "comparison": [
            {
                "name": line.name,
                "unit": line.unit,
                "published": line.published,
                "measured": line.measured._asdict(),
                "weighted": None if line.weighted is None else line.weighted._asdict(),
                "largest": line.largest,
            }
            for line in lines(result)
        ],
        "alignments": {
            name: {"rotation": each.rotation.tolist(), "degrees": each.turn, "score": asdict(each.score)}
            for name, each in result.aligned.items()
        },
        "remarks": remarks(result),
    }


def rows(result: Result) -> list[tuple[str, str, str, str, str]]:
    """The cells of the table: what, published, measured with its interval, weighted, largest."""
    found = []
    for line in lines(result):
        digits = 1 if line.unit in ("degrees", "%") else 2
        measured = _number(line.measured.value, digits)
        if line.weighted is not None:
            low, high = _number(line.measured.lower, digits), _number(line.measured.upper, digits)
            measured += f" ({low} to {high})"
        weighted = "–" if line.weighted is None else _number(line.weighted.value, digits)
        largest = "–" if line.largest is None else _number(line.largest, digits)
        name = f"{line.name} ({line.unit})"
        found.append((name, _number(line.published, digits), measured, weighted, largest))
    return found


HEADINGS = ("", "published", "measured (95 %)", "sin-weighted", "largest")


def as_markdown(result: Result) -> str:
    """The same, to be read."""
    title = "Technical validation, simulated" if result.setup["simulated"] else "Technical validation"
    table = [HEADINGS, ("---", "---:", "---:", "---:", "---:"), *rows(result)]
    text = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in table)
    notes = "\n".join(f"- {remark}" for remark in remarks(result))
    kabsch = result.aligned["kabsch"].score
    other = (
        f"Aligned by Kabsch instead: {kabsch.angle.mean.value:.1f} degrees, "
        f"{kabsch.vector.mean.value:.2f} N of error vector."
    )
    return (
        f"# {title}\n\nSolver {result.setup['solver']}, {len(result.desired)} forces of "
        f"{result.setup['force']:g} N. Published: {SOURCE}.\n\n{text}\n\n{other}\n\n{notes}\n"
    )


def as_latex(result: Result) -> str:
    """The table for a paper; it needs the package booktabs."""
    names = {
        '"magnitude error", as | |F| - |F0| | (N)': r"Magnitude error, as $\bigl|\,|F|-|F_0|\,\bigr|$ (N)",
        '"magnitude error", as |F - F0| (N)': r"Magnitude error, as $|F-F_0|$ (N)",
    }
    body = [
        " & ".join([names.get(row[0], row[0][0].upper() + row[0][1:]).replace("%", r"\%"), *row[1:]]) + r" \\"
        for row in rows(result)
    ]
    header = " & ".join(HEADINGS).replace("%", r"\%") + r" \\"
    what = "% Simulated modules." if result.setup["simulated"] else "% Real modules."
    out = [what, r"\begin{tabular}{lrrrr}", r"\toprule", header, r"\midrule", *body, r"\bottomrule"]
    return "\n".join([*out, r"\end{tabular}", ""]).replace("–", "--")


def _number(value: float, digits: int) -> str:
    """So many decimals; more significant ones for what would be shown as zero."""
    return f"{value:.{digits}f}" if value == 0.0 or abs(value) >= 0.5 * 10.0**-digits else f"{value:.0e}"
