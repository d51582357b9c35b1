"""Report of a validation: measured and published numbers, as text, JSON and Markdown."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.model.files import rig_from_toml
from tensionlab.model.layouts import ring_plus_top
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.table import Column, Table
from tensionlab.validation.data_tables import Recording
from tensionlab.validation.protocol import AXIS_FORCES, Measurement
from tensionlab.validation.sensors import SAMPLE_RATE_HZ, UPRIGHT
from tensionlab.validation.statistics import ALIGNMENTS, rotation_angle, score

if TYPE_CHECKING:
    import pandas

SAME_PLACE_M = 1e-3  # distance of anchors below which a rig is the published one
TILTED_DEG = 1.0  # difference of the two alignments above which the report mentions tilt
SOURCE = "Bartels et al. 2026, arXiv 2603.08054"
# Name, unit, row of the statistics and published number of each line.
LINES = (
    ("mean angle error", "degrees", "angle", 14.0),
    ("vectors within 45 degrees", "%", "within", 100.0),
    ("mean magnitude", "N", "magnitude", 1.84),
    ('"magnitude error", as | |F| - |F0| |', "N", "magnitude_error", 0.58),
    ('"magnitude error", as |F - F0|', "N", "vector", 0.58),
)
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


@dataclass(frozen=True, eq=False)
class AlignedForces:
    """Measured forces in the devices' axes after one alignment of the sensor."""

    rotation: Floats  # (3, 3)
    angle: float  # of the rotation, in degrees
    forces: Floats  # (K, 3), in N
    score: pandas.DataFrame  # of `tensionlab.validation.statistics.score`


@dataclass(frozen=True, eq=False)
class ValidationResult:
    """Measurements of a complete validation, the axes first, and the forces by each of `ALIGNMENTS`.

    The setup is `ValidationPlan.setup`; desired forces (K, 3) are without the axes, in N.
    """

    setup: Mapping[str, Any]
    measurements: tuple[Measurement, ...]
    desired: Floats
    aligned: dict[str, AlignedForces]

    @property
    def title(self) -> str:
        """Kind, solver, and number and size of the forces."""
        setup = self.setup
        return f"{len(self.desired)} forces of {setup['force']:g} N, {self.kind}, solver {setup['solver']}"

    @property
    def kind(self) -> str:
        """Origin of the forces: "simulated" or "measured"."""
        return "simulated" if self.setup["simulated"] else "measured"

    def __repr__(self) -> str:
        mean = self.aligned["paper"].score["mean"]
        errors = f"mean angle error {mean['angle']:.1f}°, error vector {mean['vector']:.2f} N"
        return f"<ValidationResult of {self.title}: {errors}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return the published numbers and those of this rig, line by line."""
        rows = []
        for name, row in comparison(self).items():
            mean, rest = f"{row['mean']:.3g}", (None, None)
            if row["quantity"] != "within":
                mean += f" ({row['mean_lower']:.3g} to {row['mean_upper']:.3g})"
                rest = row["weighted"], row["maximum"]
            rows.append([f"{name} ({row['unit']})", row["published"], mean, *rest])
        columns = ["", Column("published", format=".3g"), Column(self.kind, "95 %"),
                   Column("sin-weighted", format=".3g"), Column("maximum", format=".3g")]  # fmt: skip
        return Table(columns, rows, self.title, remarks(self))

    @property
    def exact(self) -> int:
        """Number of forces that the nominal rig can render."""
        return sum(measurement.status == "EXACT" for measurement in self.measurements[AXIS_FORCES:])

    @property
    def fallback_used(self) -> int:
        """Number of unproven answers of the solver, for which the exact solver's were sent."""
        return sum(measurement.fallback_used for measurement in self.measurements[AXIS_FORCES:])

    @property
    def rested(self) -> float:
        """Time for which modules had to cool between forces, in s."""
        return sum(measurement.rested for measurement in self.measurements)


def evaluate(setup: Mapping[str, Any], measurements: Sequence[Measurement]) -> ValidationResult:
    """Return the result of a complete validation, aligned by what the nominal rig renders on the axes."""
    measured = np.array([measurement.measured for measurement in measurements]) @ UPRIGHT.T
    rendered = np.array([measurement.rendered for measurement in measurements])
    desired = np.array([measurement.desired for measurement in measurements])[AXIS_FORCES:]
    aligned = {}
    for name, fit_alignment in ALIGNMENTS.items():
        rotation = fit_alignment(rendered[:AXIS_FORCES], measured[:AXIS_FORCES])
        forces = measured[AXIS_FORCES:] @ rotation.T
        aligned[name] = AlignedForces(rotation, rotation_angle(rotation), forces, score(desired, forces))
    return ValidationResult(setup, tuple(measurements), desired, aligned)


def make_recording(result: ValidationResult, rig: Rig, sensor: str, manifest: Mapping[str, Any]) -> Recording:
    """Return the forces without the axes, aligned as published, as a recording that others can read.

    ``sensor`` says what measured; the manifest is that of `tensionlab.support.provenance`.
    """
    kept, setup = result.measurements[AXIS_FORCES:], result.setup
    about = {
        "simulated": setup["simulated"],
        "rig": rig.name,
        "modules": [module.name for module in rig.modules],
        "solver": setup["solver"],
        "sensor": sensor,
        "rotations": {name: (fit.rotation @ UPRIGHT).tolist() for name, fit in result.aligned.items()},
        "alignment": "paper",
        "rate": float(SAMPLE_RATE_HZ),
        "hold": setup["hold"],
        "settle": setup["settle"],
        "preset": setup["preset"],
    }
    same = ("rendered", "tensions", "spread", "fallback_used", "samples")
    return Recording(
        desired=result.desired,
        measured=result.aligned["paper"].forces,
        status=np.array([Status[measurement.status] for measurement in kept], dtype=np.int64),
        limited_modules=np.array([" ".join(measurement.limited_modules) for measurement in kept]),
        manifest={**manifest, "recording": about},
        **{name: np.array([getattr(measurement, name) for measurement in kept]) for name in same},
    )


def comparison(result: ValidationResult) -> dict[str, dict[str, Any]]:
    """Return the numbers that are compared, of forces aligned as published, by their names."""
    scores = result.aligned["paper"].score
    return {
        name: {"quantity": quantity, "unit": unit, "published": published, **scores.loc[quantity]}
        for name, unit, quantity, published in LINES
    }


def remarks(result: ValidationResult) -> list[str]:
    """Return the remarks that the numbers need, a sentence or two each."""
    setup = result.setup
    count = len(result.desired)
    window = f"from {setup['settle']:g} to {setup['hold']:g} s of each force"
    notes = [READING, GRID, f"Averages are {window}: tensions still move before."]
    rig, published = rig_from_toml(setup["rig"], "rig of the setup"), ring_plus_top(1.0)
    if rig.m != published.m or np.abs(rig.anchors - published.anchors).max() > SAME_PLACE_M:
        advice = "take the published column as an order of magnitude, not as a target"
        notes.insert(0, f"{rig.name} is not the published rig: {advice}.")
    if setup["simulated"]:
        which = f"preset {setup['preset']}, seed {setup['seed']}" if setup["preset"] else "in another process"
        notes.insert(0, f"These modules are simulated: {which}.")
    if result.exact < count:
        notes.append(f"{result.exact} of {count} forces are feasible; of the others, the nearest was rendered.")
    if result.fallback_used:
        notes.append(
            f"In {result.fallback_used} of {count} forces {setup['solver']} left its answer unproven, so that "
            "newton's was sent: not all of these numbers are its own."
        )
    tilt = rotation_angle(result.aligned["kabsch"].rotation @ result.aligned["paper"].rotation.T)
    if tilt > TILTED_DEG:  # which the published alignment leaves in the errors
        notes.append(
            f"The best rotation (Kabsch) differs from the published alignment by {tilt:.1f} degrees: the "
            "sensor leans, or the forces on the axes are off; a turn about the vertical leaves that in the errors."
        )
    if result.rested:
        notes.append(f"Modules had to rest for {result.rested:.0f} s in all, so that windings could cool.")
    limited = Counter(name for measurement in result.measurements for name in measurement.limited_modules)
    return notes + [
        f"Module {name} was at a limit of its own at {times} forces." for name, times in limited.items()
    ]


def as_json(result: ValidationResult, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the whole report, for programs."""
    return {
        "manifest": manifest,
        "simulated": result.setup["simulated"],
        "setup": {key: value for key, value in result.setup.items() if key != "directions"},
        "vectors": len(result.desired),
        "exact": result.exact,
        "fallback_used": result.fallback_used,
        "rested": result.rested,
        "source": SOURCE,
        "comparison": comparison(result),
        "alignments": {
            name: {"rotation": fit.rotation, "degrees": fit.angle, "score": fit.score.to_dict("index")}
            for name, fit in result.aligned.items()
        },
        "remarks": remarks(result),
    }


def as_markdown(result: ValidationResult) -> str:
    """Return the report as Markdown."""
    title = "Technical validation, simulated" if result.setup["simulated"] else "Technical validation"
    kabsch = result.aligned["kabsch"].score["mean"]
    table = result.table()
    table.notes = [
        f"Aligned by Kabsch instead: {kabsch['angle']:.1f} degrees, {kabsch['vector']:.2f} N of error vector.",
        "\n".join(f"- {remark}" for remark in remarks(result)),
    ]
    return (
        f"# {title}\n\nSolver {result.setup['solver']}, {len(result.desired)} forces of "
        f"{result.setup['force']:g} N. Published: {SOURCE}.\n\n{table.to_markdown()}\n"
    )
