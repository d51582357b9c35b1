"""Report of a characterisation: its table, all measurements as rows, and published devices for comparison."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.model.wall_stiffness import HAND_DAMPING
from tensionlab.support.table import Column, Table
from tensionlab.validation.characterisation import Characterisation
from tensionlab.validation.measurements import WallTrial
from tensionlab.validation.simulated_hand import HAND_MASS_KG
from tensionlab.validation.statistics import deviations

if TYPE_CHECKING:
    import pandas

WHOLE = "rig"  # column of what is not of an axis
FIGURES = {"force": "N", "friction": "N", "inertia": "kg", "stiffness": "N/m"}  # of published devices


def wall_limits(trials: list[WallTrial]) -> tuple[float, float]:
    """Return the largest stable and the largest passive stiffness in N/m, interpolated between trials, or NaN."""
    largest = max((trial.stiffness for trial in trials if trial.stable), default=math.nan)
    above = min((trial.stiffness for trial in trials if trial.stiffness > largest), default=largest)
    for softer, stiffer in pairwise(trials):
        if softer.added_damping >= 0.0 > stiffer.added_damping:
            pair = [-softer.added_damping, -stiffer.added_damping], [softer.stiffness, stiffer.stiffness]
            return math.sqrt(largest * above), float(np.interp(0.0, *pair))
    return math.sqrt(largest * above), math.nan


class Quantity(NamedTuple):
    """Measured number: by axis, or under `WHOLE`."""

    name: str
    unit: str
    values: dict[str, float]
    note: str = ""


def quantities(result: Characterisation) -> list[Quantity]:
    """Return the numbers of the report, in its order."""
    plan, cable, steps = result.plan, result.backdrive, result.steps.items()
    desired = np.array([force.desired for force in result.static])
    measured = np.array([force.measured for force in result.static])
    angle, _, _, vector = deviations(desired, measured)
    places = 1e3 * np.array([np.linalg.norm(force.found - force.position) for force in result.static])
    entries = [
        Quantity("force error, mean", "N", {WHOLE: float(vector.mean())}, f"{len(vector)} of {plan.force:g} N"),
        Quantity("force error, largest", "N", {WHOLE: float(vector.max())}, f"within {plan.reach:g} m of home"),
        Quantity("angle error, mean", "°", {WHOLE: float(np.nanmean(angle))}),
        Quantity("position error, largest", "mm", {WHOLE: float(places.max())}, f"mean {places.mean():.2g} mm"),
        Quantity("latency to 10 % of a step", "ms", {axis: 1e3 * step.latency for axis, step in steps},
               f"step of {plan.step:g} N"),
        Quantity("rise from 10 to 90 %", "ms", {axis: 1e3 * step.rise for axis, step in steps}),
        Quantity("overshoot", "%", {axis: 100.0 * step.overshoot for axis, step in steps}),
        Quantity("force bandwidth", "Hz",
               {axis: response.bandwidth for axis, response in result.responses.items()},
               f"by the host, {plan.amplitude:g} N at {plan.rate:g} cycles/s"),
        *(Quantity(f"vibration bandwidth, {module}", "Hz", {WHOLE: response.bandwidth}, "by the module")
          for module, response in result.vibrations.items()),
        *(Quantity(f"backdrive {name}", unit, {axis: part[index] for axis, part in result.backdrive_along.items()})
          for index, (name, unit) in enumerate((("friction", "N"), ("damping", "N s/m"), ("inertia", "kg")))),
        Quantity("friction of a cable", "N", {WHOLE: cable.friction}, f"minimum tension {cable.tension:.2g} N"),
        Quantity("damping of a cable", "N s/m", {WHOLE: cable.damping}),
    ]  # fmt: skip
    for damping, trials in result.walls.items():
        stable, passive = wall_limits(trials)
        note = "never passive" if math.isnan(passive) else f"passive up to {passive:.0f} N/m"
        entries.append(Quantity(f"stable stiffness at {damping:g} N s/m", "N/m", {result.wall_axis: stable}, note))
    for name, times in (("round trip of a ping", result.round_trips), ("set-point to report", result.delays)):
        median, late = 1e3 * np.nanpercentile(times, [50.0, 99.0])
        entries.append(Quantity(name, "ms", {WHOLE: float(median)}, f"99th percentile {late:.3g} ms"))
    return entries


def table(result: Characterisation) -> Table:
    """Return the numbers of the report with what is needed to understand them."""
    columns = [*"xyz", WHOLE]
    rows = [
        [f"{quantity.name} ({quantity.unit})", *map(quantity.values.get, columns), quantity.note]
        for quantity in quantities(result)
    ]
    notes = [
        "Bandwidth is where the amplitude is 3 dB below the desired one; inf is beyond what was tried. A wall is "
        "stable if a pushed hand comes to rest, and passive if it gives the hand no more energy than it took."
    ]
    measured: dict[str, list[str]] = {}
    for module, response in result.vibrations.items():
        pairs = zip(response.frequencies, response.gains, strict=True)
        rows_of_file = ", ".join(f"[{frequency:.1f}, {gain:.3g}]" for frequency, gain in pairs)
        measured.setdefault(rows_of_file, []).append(module)
    for gains, names in measured.items():
        notes.append(f"For the rig file, {', '.join(names)} and modules like that: vibration_gain = [{gains}]")
    if result.simulated:
        hand = f"the hand at walls has {HAND_MASS_KG:g} kg and {HAND_DAMPING:g} N s/m"
        late = f"links are {500.0 * np.median(result.round_trips):.2g} ms late, one way"
        notes.insert(0, f"These modules are simulated, without errors of calibration; {late}; {hand}.")
    return Table(["", *(Column(name, format=".3g") for name in columns), ""], rows, result.title, notes)


def devices_table(result: Characterisation, devices: pandas.DataFrame) -> Table:
    """Return the figures of this rig, and those of published devices below."""
    friction, _, inertia = np.max([*result.backdrive_along.values()], axis=0).tolist()
    stiffest = max(wall_limits(trials)[0] for trials in result.walls.values())
    rows = [[f"{result.plan.rig.name} (here)", result.plan.force, friction, inertia, stiffest, ""]]
    rows += devices.reindex(columns=[*FIGURES, "source"]).reset_index().to_numpy().tolist()
    columns = ["device", *(Column(name, unit, ".3g") for name, unit in FIGURES.items()), "source"]
    note = (
        "Other protocols: compare orders of magnitude. Here, force is the one held, and stiffness that of the "
        "stiffest stable wall by the host. A dash is a figure that its source does not give, or was not checked."
    )
    return Table(columns, rows, "published devices", [note])


def rows(result: Characterisation) -> list[dict[str, Any]]:
    """Return all measurements, one a row: what, of which part, at which value of what, and the result."""
    records: list[dict[str, Any]] = []

    def add(what: str, part: str, at: float, at_unit: str, value: float, unit: str) -> None:
        row = {"measurement": what, "of": part, "at": float(at), "at_unit": at_unit}
        records.append(row | {"value": float(value), "unit": unit})

    for quantity in quantities(result):
        for part, value in quantity.values.items():
            add(quantity.name, part, math.nan, "", value, quantity.unit)
    for number, held in enumerate(result.static):
        for axis, wanted, got in zip("xyz", held.desired, held.measured, strict=True):
            add("desired force", axis, number, "", wanted, "N")
            add("measured force", axis, number, "", got, "N")
    for part, response in (result.responses | result.vibrations).items():
        for frequency, gain in zip(response.frequencies, response.gains, strict=True):
            add("gain", part, frequency, "Hz", gain, "1")
    for axis, step in result.steps.items():
        for time, force in zip(step.times, step.force, strict=True):
            add("step response", axis, time, "s", force, "N")
    for trial in (trial for trials in result.walls.values() for trial in trials):
        add("growth at a wall", f"{trial.damping:g} N s/m", trial.stiffness, "N/m", trial.growth, "1/s")
        add("added damping", f"{trial.damping:g} N s/m", trial.stiffness, "N/m", trial.added_damping, "N s/m")
    return records


def as_json(result: Characterisation, devices: pandas.DataFrame, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the whole report, for programs."""
    return {"manifest": manifest, "rig": result.plan.rig.name, "simulated": result.simulated,
            "figures": quantities(result), "walls": result.walls, "devices": devices.to_dict("index")}  # fmt: skip


def as_markdown(result: Characterisation, devices: pandas.DataFrame) -> str:
    """Return the report as Markdown."""
    shown = table(result).to_markdown(), devices_table(result, devices).to_markdown()
    return f"# Characterisation of {result.title}\n\n{shown[0]}\n\n## Published devices\n\n{shown[1]}\n"
