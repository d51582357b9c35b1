"""Report of a characterisation: its table, its measurements one by one, and published devices beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict

from tensionlab.errors import DataError
from tensionlab.model.stiffness import HAND_DAMPING, stiffness_bound
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import read_toml
from tensionlab.support.table import Column, Table
from tensionlab.support.validation import validate
from tensionlab.validation.characterisation import HAND_MASS_KG, Characterisation
from tensionlab.validation.measurements import FrequencyResponse, WallTrial
from tensionlab.validation.statistics import deviations

AXES = "xyz"


@dataclass(frozen=True)
class Device:
    """Published device: figures in SI units, None where its publication has none, and their source."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    name: str
    source: str
    force: float | None = None
    continuous_force: float | None = None
    friction: float | None = None
    inertia: float | None = None
    stiffness: float | None = None
    force_rate: float | None = None
    resolution: float | None = None


@dataclass(frozen=True)
class _Devices:
    __pydantic_config__ = ConfigDict(extra="forbid")

    devices: list[Device]


def read_devices(path: str | Path) -> list[Device]:
    """Read published devices (TOML); raise `DataError`, which says what is missing or unknown."""
    content = read_toml(path, "published devices (*.toml)", DataError)
    return validate(_Devices, content, DataError, path).devices


def wall_limits(trials: list[WallTrial]) -> tuple[float, float]:
    """Return the largest stable and the largest passive stiffness, in N/m; NaN where no trial was.

    A stable one is between the trials on either side of it; a passive one is where the energy that the observer
    counts changes its sign, between trials.
    """
    stable = [trial.stiffness for trial in trials if trial.stable]
    unstable = [trial.stiffness for trial in trials if not trial.stable]
    largest = max(stable, default=math.nan)
    above = min((each for each in unstable if each > largest), default=largest)
    gives = next((i for i, trial in enumerate(trials) if trial.added_damping < 0.0), len(trials))
    if gives in (0, len(trials)):
        return math.sqrt(largest * above), math.nan
    before, after = trials[gives - 1], trials[gives]
    share = before.added_damping / (before.added_damping - after.added_damping)
    return math.sqrt(largest * above), before.stiffness + share * (after.stiffness - before.stiffness)


def force_deviations(result: Characterisation) -> tuple[Floats, Floats]:
    """Return the error vectors' lengths in N and the angles in degrees of the static forces, (K,) each."""
    desired, measured = (
        np.array([getattr(each, name) for each in result.static]) for name in ("desired", "measured")
    )
    found = deviations(desired, measured)
    return found.vector, found.angle


def position_errors(result: Characterisation) -> Floats:
    """Return the distance of the pose by cable lengths from the place where the sensor was held, (K,) in m."""
    return np.array([np.linalg.norm(each.found - each.position) for each in result.static])


def table(result: Characterisation) -> Table:
    """Return what was measured, line by line: along each axis, or of the whole rig."""
    rows: list[list[Any]] = []

    def whole(name: str, unit: str, value: float, note: str = "") -> None:
        rows.append([f"{name} ({unit})", *[None] * len(AXES), value, note])

    def along(name: str, unit: str, values: Mapping[str, Any], note: str = "") -> None:
        rows.append([f"{name} ({unit})", *(values.get(axis) for axis in AXES), None, note])

    def of_steps(get: Callable[[Any], float]) -> dict[str, float]:
        return {axis: get(step) for axis, step in result.steps.items()}

    plan = result.plan
    vector, angle = force_deviations(result)
    places = 1e3 * position_errors(result)
    whole("force error, mean", "N", float(vector.mean()), f"{len(vector)} forces of {plan.force:g} N")
    whole("force error, largest", "N", float(vector.max()), f"within {plan.reach:g} m of home")
    whole("angle error, mean", "°", float(np.nanmean(angle)))
    whole("position error, mean", "mm", float(places.mean()), "by cable lengths")
    whole("position error, largest", "mm", float(places.max()))
    along("latency to 10 % of a step", "ms", of_steps(lambda step: 1e3 * step.latency), f"step of {plan.step:g} N")
    along("rise from 10 to 90 %", "ms", of_steps(lambda step: 1e3 * step.rise))
    along("overshoot", "%", of_steps(lambda step: 100.0 * step.overshoot))
    along("force bandwidth", "Hz", {axis: bandwidth(each) for axis, each in result.responses.items()},
          f"by the host, {plan.amplitude:g} N at {plan.rate:g} cycles/s")  # fmt: skip
    for module, response in result.vibrations.items():
        whole(f"vibration bandwidth, {module}", "Hz", response.bandwidth, f"by the module, {plan.amplitude:g} N")
    for index, (name, unit) in enumerate((("friction", "N"), ("damping", "N s/m"), ("inertia", "kg"))):
        along(f"felt {name}", unit, {axis: parts[index] for axis, parts in result.felt_along.items()})
    cable = result.felt
    whole("friction of a cable", "N", cable.friction, f"{cable.damping:.2g} N s/m, {1e3 * cable.mass:.2g} g")
    whole("minimum tension", "N", cable.tension)
    for damping, trials in result.walls.items():
        stable, passive = wall_limits(trials)
        note = "never passive" if math.isnan(passive) else f"passive up to {passive:.0f} N/m"
        rows.append([f"largest stable stiffness at {damping:g} N s/m (N/m)",
                     *(stable if axis == result.wall_axis else None for axis in AXES), None, note])  # fmt: skip
    loop = 1e3 * np.nanpercentile(result.delays, [50.0, 99.0])
    trip = 1e3 * np.percentile(result.round_trips, [50.0, 99.0])
    whole("round trip of a ping", "ms", float(trip[0]), f"99th percentile {trip[1]:.3g} ms")
    whole("set-point until its report", "ms", float(loop[0]), f"99th percentile {loop[1]:.3g} ms")
    columns = ["", *(Column(axis, format=".3g") for axis in AXES), Column("rig", format=".3g"), ""]
    kind = "simulated" if result.simulated else "measured"
    return Table(columns, rows, f"{plan.rig.name}, {kind}", remarks(result))


def bandwidth(response: FrequencyResponse) -> float | str:
    """Return the bandwidth in Hz; a text where it is beyond the highest frequency."""
    return response.bandwidth if math.isfinite(response.bandwidth) else f"over {response.frequencies[-1]:g}"


def remarks(result: Characterisation) -> list[str]:
    """Return what the numbers need to be understood."""
    plan = result.plan
    found = []
    if result.simulated:
        link = f"links are {1e3 * plan.conditions.latency:g} ms late, one way"
        hand = f"the hand at walls has {HAND_MASS_KG:g} kg and {HAND_DAMPING:g} N s/m."
        errors = f"errors of preset {plan.preset}" if plan.preset else "no errors of calibration"
        found.append(f"These modules are simulated, with {errors}; {link}; {hand}")
    found.append(
        "Bandwidth is where the amplitude is 3 dB below the desired one. A wall is stable if a pushed hand comes "
        "to rest, and passive if it does not give the hand more energy than it took."
    )
    return found


def devices_table(result: Characterisation, devices: list[Device]) -> Table:
    """Return published figures of other devices, below those of this rig."""
    vector_sizes = [float(np.linalg.norm(each.desired)) for each in result.static]
    felt = list(result.felt_along.values())
    stable = max(wall_limits(trials)[0] for trials in result.walls.values())
    friction, inertia = (max(parts[index] for parts in felt) for index in (0, 2))
    noise = float(np.median(position_errors(result)))
    here = [f"{result.plan.rig.name} (here)", None, max(vector_sizes), friction, 1e3 * inertia, 1e-3 * stable]
    rows = [[*here, result.plan.rate, 1e3 * noise, "this characterisation"]]
    for device in devices:
        grams, per_mm, mm = (
            None if value is None else factor * value
            for value, factor in ((device.inertia, 1e3), (device.stiffness, 1e-3), (device.resolution, 1e3))
        )
        force = [device.name, device.force, device.continuous_force, device.friction]
        rows.append([*force, grams, per_mm, device.force_rate, mm, device.source])
    columns = [
        "device", Column("peak force", "N"), Column("held force", "N"), Column("friction", "N"),
        Column("inertia", "g", ".3g"), Column("stiffness", "N/mm", ".3g"), Column("rate", "Hz", ".4g"),
        Column("position", "mm", ".2g"), Column("source", wide=True),
    ]  # fmt: skip
    notes = [
        "Published figures are those of other protocols: compare orders of magnitude. Here, held force is the one "
        "characterised, stiffness that of the stiffest stable wall by the host, position the median error."
    ]
    return Table(columns, rows, "published devices", notes)


def theory(result: Characterisation, damping: Floats) -> Floats:
    """Return the bound of `stiffness_bound` in N/m by the round trip of a ping, for dampings in N s/m."""
    delay, period = float(np.median(result.round_trips)), 1.0 / result.plan.rate
    return stiffness_bound(delay, period, HAND_DAMPING, damping)


def rows(result: Characterisation) -> list[dict[str, Any]]:
    """Return all measurements, one a row: what, of which part, at which value of what, and the result."""
    found: list[dict[str, Any]] = []

    def add(what: str, part: str, at: float, at_unit: str, value: float, unit: str) -> None:
        found.append({"measurement": what, "of": part, "at": at, "at_unit": at_unit, "value": value, "unit": unit})

    for number, held in enumerate(result.static):
        for axis, wanted, got in zip(AXES, held.desired, held.measured, strict=True):
            add("desired force", axis, number, "force", float(wanted), "N")
            add("measured force", axis, number, "force", float(got), "N")
    for number, error in enumerate(position_errors(result)):
        add("position error", "rig", number, "force", float(error), "m")
    for name, responses in (("force gain", result.responses), ("vibration gain", result.vibrations)):
        for part, response in responses.items():
            for frequency, gain in zip(response.frequencies, response.gains, strict=True):
                add(name, part, float(frequency), "Hz", float(gain), "1")
    for axis, step in result.steps.items():
        for time, force in zip(step.times, step.force, strict=True):
            add("step response", axis, float(time), "s", float(force), "N")
    for damping, trials in result.walls.items():
        for trial in trials:
            part = f"{result.wall_axis}, {damping:g} N s/m"
            add("growth at a wall", part, trial.stiffness, "N/m", trial.growth, "1/s")
            add("damping added by a wall", part, trial.stiffness, "N/m", trial.added_damping, "N s/m")
    for axis, parts in result.felt_along.items():
        for name, unit, value in zip(("friction", "damping", "inertia"), ("N", "N s/m", "kg"), parts, strict=True):
            add(f"felt {name}", axis, math.nan, "", value, unit)
    for trip in result.round_trips:
        add("round trip", "links", math.nan, "", float(trip), "s")
    return found


def as_json(result: Characterisation, devices: list[Device], manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the whole report, for programs."""
    measured = table(result)
    headings = ["measurement", *AXES, "rig", "note"]
    return {
        "manifest": manifest,
        "rig": result.plan.rig.name,
        "simulated": result.simulated,
        "measurements": _cells(measured, headings),
        "walls": result.walls,
        "remarks": remarks(result),
        "devices": devices,
    }


def _cells(shown: Table, headings: list[str]) -> list[dict[str, Any]]:
    """Return the rows of a table by heading."""
    names = [column.name for column in shown.columns]
    keys = ["measurement", *(name for name in names[1:-1]), "note"] if names[-1] == "" else headings
    return [dict(zip(keys, row, strict=True)) for row in shown.rows]


def as_markdown(result: Characterisation, devices: list[Device]) -> str:
    """Return the report as Markdown."""
    kind = "simulated" if result.simulated else "measured"
    shown = table(result).to_markdown(), devices_table(result, devices).to_markdown()
    title = f"# Characterisation of {result.plan.rig.name}, {kind}"
    return f"{title}\n\n{shown[0]}\n\n## Published devices\n\n{shown[1]}\n"
