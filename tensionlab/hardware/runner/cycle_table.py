"""Columns of a run, and their JSON: one description of each drives the log's writer, its readers and watchers."""

# ruff: noqa: RUF009 - `column` is `dataclasses.field`
from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum, IntFlag
from operator import attrgetter
from typing import Any, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Status
from tensionlab.demand import EffectDemand, EffectTable, Impedance, tabulate_effects
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit, State
from tensionlab.hardware.runner.records import Cycle
from tensionlab.model.kinematics import planar_rotation
from tensionlab.model.pose import frame_matrix, place_anchors
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import MAX_MAGNITUDE, Floats, Integers

IMPEDANCE = Impedance._fields  # the numbers of an impedance, in their order
Flags = NDArray[np.bool_]
Statuses = NDArray[np.int8]
WRENCH = "N or N m"  # unit


def rotation_matrix(cycle: Cycle, rig: Rig) -> Floats:
    """Return the rotation of the platform as a matrix."""
    rotation = cycle.state.pose.rotation
    if rotation is None:
        return rig.home_matrix
    return planar_rotation(rotation) if rig.dimension == 2 else np.asarray(rotation, dtype=np.float64)


def desired_wrench(cycle: Cycle, rig: Rig) -> Floats:
    """Return the wrench that the application desires; NaN where it has none."""
    desired = cycle.demand.desired
    return demanded_wrench(cycle, rig) if desired is None else np.asarray(desired, dtype=np.float64)


def demanded_wrench(cycle: Cycle, rig: Rig) -> Floats:
    """Return the wrench of the demand; NaN where it has none."""
    wrench = cycle.demand.wrench
    return np.full(rig.n, np.nan) if wrench is None else np.asarray(wrench, dtype=np.float64)


def impedance_rows(cycle: Cycle, rig: Rig) -> list[tuple[float, ...]]:
    """Return the impedance of each module in the demand; NaN where it has none."""
    springs = [cycle.demand.impedances.get(module.name) for module in rig.modules]
    return [(math.nan,) * len(IMPEDANCE) if spring is None else spring for spring in springs]


def anchors_in_world(cycle: Cycle, rig: Rig) -> Floats:
    """Return the anchors in the world, those on bodies by the bodies' poses."""
    return place_anchors(rig.modules, rig.anchors, cycle.state.pose.frames)


def frame_poses(cycle: Cycle, rig: Rig) -> Floats:
    """Return rotation and position of each body frame, (frames, d, d + 1), in the order of `Rig.at_rest`."""
    d, poses = rig.dimension, rig.at_rest | dict(cycle.state.pose.frames or {})
    return np.reshape([frame_matrix(where, d) for where in poses.values()], (-1, d, d + 1))


def codes(kind: type[IntEnum | IntFlag]) -> str:
    """Return the numbers of an enumeration with their names."""
    return ", ".join(f"{member.value} {member.name}" for member in kind)


class RunColumn(NamedTuple):
    """Column of a run."""

    value: Callable[[Cycle, Rig], Any]
    unit: str
    meaning: str
    dims: tuple[str, ...]  # axes after the first, which is the cycle


def column(source: str | Callable[[Cycle, Rig], Any], unit: str, meaning: str, *dims: str) -> Any:
    """Return a field of `CycleTable` from an attribute of a cycle, or a function of the cycle and the rig."""
    value: Callable[[Cycle, Rig], Any]
    if isinstance(source, str):
        get = attrgetter(source)
        value = lambda cycle, rig: get(cycle)  # noqa: E731 - one of two functions
    else:
        value = source
    return field(metadata={"column": RunColumn(value, unit, meaning, dims)})


@dataclass(frozen=True, eq=False, kw_only=True)
class CycleTable:
    """K cycles of a run as arrays whose first axis is the cycle.

    NaN marks missing numbers: telemetry before the first, a demand without a wrench, modules without an impedance,
    set-points that were not sent.
    """

    cycle: Integers = column("state.cycle", "1", "number of the cycle")
    time: Floats = column("state.time", "s", "begin of the cycle since the run began")
    position: Floats = column("state.pose.position", "m", "position of the reference point", "axis")
    rotation: Floats = column(rotation_matrix, "1", "rotation from platform to world", "axis", "platform_axis")
    twist: Floats = column("state.twist", "m/s or rad/s", "twist that fits the cables' speeds best", "component")
    structure: Floats = column("state.structure", "1 or m", "structure matrix", "component", "module")
    lengths: Floats = column("state.lengths", "m", "length of the cable", "module")
    anchors: Floats = column(anchors_in_world, "m", "anchor in the world", "module", "axis")
    speeds: Floats = column("state.speeds", "m/s", "speed of paying out", "module")
    measured: Floats = column("state.tensions", "N", "tension that the module reports; NaN if it is old", "module")
    ages: Floats = column("state.ages", "s", "time since the latest telemetry", "module")
    active: Flags = column("state.active", "1", "whether the module takes part", "module")
    states: Integers = column("state.states", "1", f"state of the module: {codes(State)}", "module")
    faults: Integers = column("state.faults", "1", f"faults of the module, bits: {codes(Fault)}", "module")
    limiters: Integers = column("state.limiters", "1", f"what limits the tension: {codes(Limit)}", "module")
    brake_states: Integers = column("state.brakes", "1", f"brake: {codes(BrakeState)}; -1: not known", "module")
    last_sequence: Integers = column("state.last_sequence", "1", "last set-point followed; -1: none yet", "module")
    delays: Floats = column("state.delays", "s", "time since that set-point was sent", "module")
    windings: Floats = column("state.windings", "°C", "estimated temperature of the winding", "module")
    upper_now: Floats = column("state.upper_now", "N", "upper limit: the rig's, or less: heat or a body", "module")
    clearance: Floats = column("state.clearance", "m", "distance of the cable from the nearest body", "module")
    frames: Floats = column(frame_poses, "1, m", "rotation and position of a frame", "frame", "axis", "entry")
    desired: Floats = column(desired_wrench, WRENCH, "desired wrench, with what the rig requires", "component")
    demanded: Floats = column(demanded_wrench, WRENCH, "part of it that the loop renders stably", "component")
    solver_wrench: Floats = column(
        "solver_wrench", WRENCH, "demanded wrench minus what impedances and lost modules pull", "component"
    )
    impedances: Floats = column(impedance_rows, "SI", f"commanded {', '.join(IMPEDANCE)}", "module", "impedance")
    commanded_brakes: Flags = column(
        lambda cycle, rig: [module.name in cycle.demand.brakes for module in rig.modules],
        "1", "whether the brake is commanded on", "module",
    )  # fmt: skip
    stop: Flags = column("demand.stop", "1", "whether the demand ends the run")
    chosen: Floats = column("allocation.tensions", "N", "tension that the solver chose", "module")
    rendered: Floats = column("allocation.wrench", WRENCH, "wrench that the chosen tensions exert", "component")
    residual: Floats = column("allocation.residual", "N", "norm of the solver's wrench minus the rendered one")
    status: Statuses = column("allocation.status", "1", f"what is verified about the choice: {codes(Status)}")
    scale: Floats = column("allocation.scale", "1", "share of the wrench that the direction policy renders")
    iterations: Integers = column("allocation.iterations", "1", "iterations of the solver")
    separation: Floats = column("allocation.separation", "1", "direction that proves infeasibility", "component")
    fallback_used: Flags = column("fallback_used", "1", "whether the exact solver's answer was sent")
    commanded: Floats = column(
        "commanded", "N", "set-point that was sent, with the friction it compensates", "module"
    )
    sequences: Integers = column("sequences", "1", "sequence number of the set-point; -1: none sent", "module")
    start_delay: Floats = column("start_delay", "s", "begin of the cycle after its deadline")
    compute_time: Floats = column("compute_time", "s", "time that the host needed for the cycle")


COLUMNS: dict[str, RunColumn] = {entry.name: entry.metadata["column"] for entry in fields(CycleTable)}
# Type of the numbers of each column: `NDArray[kind]` is `ndarray[shape, dtype[kind]]`.
TYPES = {name: np.dtype(get_args(get_args(hint)[1])[0]) for name, hint in get_type_hints(CycleTable).items()}


def labels(rig: Rig) -> dict[str, list[str]]:
    """Return the names of the entries along each dimension of the columns."""
    axes = list("xyz"[: rig.dimension])
    torques = [] if rig.n == rig.dimension else ["z"] if rig.dimension == 2 else axes
    return {
        "module": [module.name for module in rig.modules],
        "component": [f"F{axis}" for axis in axes] + [f"M{axis}" for axis in torques],
        "axis": axes,
        "platform_axis": axes,
        "impedance": list(IMPEDANCE),
        "frame": list(rig.at_rest),
        "entry": [*axes, "position"],
    }


def schema() -> dict[str, Any]:
    """Return the JSON schema of a cycle.

    Foxglove reads schemas of numbers and of plain lists only. So arrays of more dimensions are written row by
    row, and only the descriptions tell that NaN and infinity are written as null.
    """
    properties: dict[str, Any] = {}
    for name, (_, unit, meaning, dims) in COLUMNS.items():
        kind: dict[str, Any] = {"type": {"f": "number", "b": "boolean", "i": "integer"}[TYPES[name].kind]}
        null = "; null: NaN or infinite" if TYPES[name].kind == "f" else ""
        rows = f"; {' x '.join(dims)}, row by row" if len(dims) > 1 else ""
        described = {"description": f"{meaning} ({unit}{rows}{null})"}
        properties[name] = described | ({"type": "array", "items": kind} if dims else kind)
    return {"title": "tensionlab.Cycle", "type": "object", "properties": properties}


def encode(cycle: Cycle, rig: Rig) -> bytes:
    """Return a cycle in JSON, with null for NaN and infinity."""
    row = {}
    for name, column in COLUMNS.items():
        array = np.asarray(column.value(cycle, rig), dtype=TYPES[name])
        row[name] = (array.ravel() if column.dims else array).tolist()
    text = json.dumps(row, separators=(",", ":")).encode()
    for word in (b"NaN", b"-Infinity", b"Infinity"):  # in no name of a column, and there is no other text
        text = text.replace(word, b"null")
    return text


EFFECT_NUMBERS = EffectTable._fields[1:]  # numbers of an effect besides its force
EFFECTS_SCHEMA: dict[str, Any] = {
    "title": "tensionlab.Effects",
    "type": "object",
    "properties": {
        "cycle": {"type": "integer", "description": "number of the cycle"},
        "names": {"type": "array", "items": {"type": "string"}, "description": "effects that are active"},
        **{
            name: {"type": "array", "items": {"type": "number"}, "description": f"{meaning}, effect by effect"}
            for name, meaning in {
                "force": "desired force on the hand, without a vibration (N)",
                "stiffness": "desired (N/m; 0: none)",
                "damping": "desired (N s/m; 0: none)",
                "frequency": "of ripples that pass or a vibration (Hz; 0: none)",
                "amplitude": "of a vibration (N)",
                "gain": "that vibration on the hand per amplitude of the reported tensions (1)",
                "share": "smallest share of a parameter that is rendered (1)",
            }.items()
        },
    },
}


def encode_effects(cycle: Cycle) -> bytes:
    """Return what the effects of a cycle desire, in JSON."""
    effects = cycle.demand.effects
    row: dict[str, Any] = {"cycle": cycle.state.cycle, "names": [*effects]}
    row["force"] = [float(component) for effect in effects.values() for component in effect.force]
    row |= {name: [float(getattr(effect, name)) for effect in effects.values()] for name in EFFECT_NUMBERS}
    return json.dumps(row, separators=(",", ":")).encode()


def decode_effects(rows: list[bytes], cycles: Integers, dimension: int) -> dict[str, EffectTable]:
    """Return the effects of a run from their JSON, over its cycles; errors as those of `decode`."""
    demands: dict[int, dict[str, EffectDemand]] = {}
    for row in map(json.loads, rows):
        forces = np.reshape(np.array(row["force"], dtype=np.float64), (len(row["names"]), dimension))
        numbers = zip(*(map(float, row[name]) for name in EFFECT_NUMBERS), strict=True)
        demands[int(row["cycle"])] = {
            str(name): replace(EffectDemand(force, *known), softened={"": (1.0, share)})
            for name, force, (*known, share) in zip(row["names"], forces, numbers, strict=True)
        }
    return tabulate_effects([demands.get(cycle, {}) for cycle in cycles.tolist()], dimension)


def decode(rows: list[bytes], rig: Rig) -> dict[str, NDArray[Any]]:
    """Return the columns of cycles in JSON.

    A KeyError, TypeError, ValueError, OverflowError or RecursionError if one is no cycle of this rig.
    """
    parsed = [json.loads(row) for row in rows]
    length, table = {dim: len(names) for dim, names in labels(rig).items()}, {}
    for name, column in COLUMNS.items():
        values = np.array([row[name] for row in parsed], dtype=TYPES[name])
        if values.dtype.kind == "f" and (np.abs(values[np.isfinite(values)]) >= MAX_MAGNITUDE).any():
            raise ValueError(f"a number of {MAX_MAGNITUDE:g} or more in {name}")
        table[name] = values.reshape(len(rows), *(length[dim] for dim in column.dims))
    if not (np.isfinite(table["time"]).all() and np.isfinite(table["start_delay"]).all()):
        raise ValueError("a cycle without a time")
    if unknown := set(table["status"].tolist()) - {int(status) for status in Status}:
        raise ValueError(f"status {min(unknown)}")
    return table
