"""What is kept of every cycle of a run: names, units and meanings, for the file and for who reads it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Status
from tensionlab.arrays import MAX_MAGNITUDE, Floats, Integers
from tensionlab.demand import Impedance
from tensionlab.hardware.protocol.codes import Fault, Limit, State
from tensionlab.hardware.runner.statistics import Cycle
from tensionlab.model.rig import Rig

IMPEDANCE = tuple(each.name for each in fields(Impedance))
"""The numbers of an impedance, in their order."""
INFINITIES = ((b"NaN", b"null"), (b"-Infinity", b"null"), (b"Infinity", b"null"))


def words(kind: type[IntEnum | IntFlag]) -> str:
    """Which number means what?"""
    return ", ".join(f"{member.value} {member.name}" for member in kind)


class Column(NamedTuple):
    """What is a column of a run? ``dims`` are its axes after the first, which is the cycle."""

    dims: tuple[str, ...]
    unit: str
    meaning: str


@dataclass(frozen=True, eq=False)
class CycleTable:
    """What happened in the cycles of a run, K of them? Arrays whose first axis is the cycle.

    `COLUMNS` has dimensions, unit and meaning of each. The first ones are those of `RigState`, then come the
    demand, the allocation and the rest of `Cycle`. NaN stands for what was not there: telemetry before the first,
    a demand without a wrench, modules without an impedance, set-points that were not sent.
    """

    cycle: Annotated[Integers, Column((), "1", "number of the cycle")]
    time: Annotated[Floats, Column((), "s", "begin of the cycle since the run began")]
    position: Annotated[Floats, Column(("axis",), "m", "position of the reference point")]
    rotation: Annotated[Floats, Column(("axis", "platform_axis"), "1", "rotation from platform to world")]
    twist: Annotated[Floats, Column(("component",), "m/s or rad/s", "twist that fits the cables' speeds best")]
    structure: Annotated[Floats, Column(("component", "module"), "1 or m", "structure matrix")]
    lengths: Annotated[Floats, Column(("module",), "m", "length of the cable")]
    speeds: Annotated[Floats, Column(("module",), "m/s", "speed of paying out")]
    measured: Annotated[Floats, Column(("module",), "N", "tension that the module said it pulls with")]
    ages: Annotated[Floats, Column(("module",), "s", "time since the latest telemetry")]
    active: Annotated[NDArray[np.bool_], Column(("module",), "1", "whether the module takes part")]
    states: Annotated[Integers, Column(("module",), "1", f"state of the module: {words(State)}")]
    faults: Annotated[Integers, Column(("module",), "1", f"faults of the module, bits: {words(Fault)}")]
    limiters: Annotated[Integers, Column(("module",), "1", f"what limits the module's tension: {words(Limit)}")]
    last_sequence: Annotated[
        Integers, Column(("module",), "1", "sequence number of the last set-point followed; -1: none yet")
    ]
    delays: Annotated[Floats, Column(("module",), "s", "time since that set-point was sent")]
    thermal: Annotated[Floats, Column(("module",), "1", "share of the winding's budget that is spent")]
    upper_now: Annotated[Floats, Column(("module",), "N", "upper limit: the rig's, or less where it is warm")]
    desired: Annotated[Floats, Column(("component",), "N or N m", "wrench that was asked for")]
    solver_wrench: Annotated[
        Floats, Column(("component",), "N or N m", "what of it the solver was asked for: impedances pull the rest")
    ]
    impedances: Annotated[
        Floats, Column(("module", "impedance"), "SI", f"impedance asked for: {', '.join(IMPEDANCE)}")
    ]
    commanded_brakes: Annotated[NDArray[np.bool_], Column(("module",), "1", "whether the brake was asked for")]
    stop: Annotated[NDArray[np.bool_], Column((), "1", "whether the end of the run was asked for")]
    chosen: Annotated[Floats, Column(("module",), "N", "tension that the solver chose")]
    rendered: Annotated[Floats, Column(("component",), "N or N m", "wrench that the chosen tensions exert")]
    residual: Annotated[Floats, Column((), "N", "norm of the wrench asked for minus the one rendered")]
    status: Annotated[NDArray[np.int8], Column((), "1", f"what is proved about the choice: {words(Status)}")]
    scale: Annotated[Floats, Column((), "1", "share of the wrench that is rendered, by the direction policy")]
    iterations: Annotated[Integers, Column((), "1", "iterations of the solver")]
    separation: Annotated[Floats, Column(("component",), "1", "direction that proves the wrench out of reach")]
    fallback_used: Annotated[NDArray[np.bool_], Column((), "1", "whether the exact solver had to take over")]
    commanded: Annotated[Floats, Column(("module",), "N", "set-point that was sent")]
    sequences: Annotated[Integers, Column(("module",), "1", "sequence number of the set-point; -1: none sent")]
    start_delay: Annotated[Floats, Column((), "s", "begin of the cycle after its deadline")]
    compute_time: Annotated[Floats, Column((), "s", "time that the host needed for the cycle")]


HINTS = get_type_hints(CycleTable, include_extras=True)
COLUMNS: dict[str, Column] = {name: hint.__metadata__[0] for name, hint in HINTS.items()}
"""All columns, by name."""
TYPES: dict[str, np.dtype[Any]] = {
    name: np.dtype(get_args(get_args(hint.__origin__)[1])[0]) for name, hint in HINTS.items()
}
"""Of which type each is."""
OLD_NAMES = {
    "measured": "tensions",
    "limiters": "limits",
    "last_sequence": "taken",
    "desired": "demanded",
    "solver_wrench": "asked",
    "commanded_brakes": "brakes",
    "fallback_used": "replaced",
    "commanded": "sent",
    "start_delay": "late",
    "compute_time": "work",
}
"""Columns that had another name in logs of the first edition."""
LATER_COLUMNS = frozenset({"upper_now"})
"""Columns that the first logs do not have; NaN there."""


def sizes(rig: Rig) -> dict[str, int]:
    """How long are the dimensions of the columns?"""
    d = rig.dimension
    return {"axis": d, "platform_axis": d, "component": rig.n, "module": rig.m, "impedance": len(IMPEDANCE)}


def schema(rig: Rig) -> dict[str, Any]:
    """How does a cycle look in JSON? As a JSON schema.

    Foxglove reads schemas of numbers and of plain lists only. So arrays of more dimensions are written row by
    row, and only words say that null stands for NaN and infinity.
    """
    length = sizes(rig)
    properties: dict[str, Any] = {}
    for name, column in COLUMNS.items():
        dims = column.dims
        shape: dict[str, Any] = {"type": {"f": "number", "b": "boolean", "i": "integer"}[TYPES[name].kind]}
        if dims:
            count = math.prod(length[dim] for dim in dims)
            shape = {"type": "array", "items": shape, "minItems": count, "maxItems": count}
        null = "; null: NaN or infinite" if TYPES[name].kind == "f" else ""
        rows = f"; {' x '.join(dims)}, row by row" if len(dims) > 1 else ""
        text = f"{column.meaning} ({column.unit}{rows}{null})"
        properties[name] = {"description": text, **shape}
    properties["status"]["oneOf"] = [{"const": int(status), "title": status.name} for status in Status]
    return {"title": "tensionlab.Cycle", "type": "object", "properties": properties}


def encode(cycle: Cycle, rig: Rig) -> bytes:
    """How is a cycle written in JSON, which knows neither NaN nor infinity? They are null."""
    text = json.dumps(_row(cycle, rig), separators=(",", ":")).encode()
    for word, null in INFINITIES:  # no name of a column looks like these, and there is no other text
        text = text.replace(word, null)
    return text


def _row(cycle: Cycle, rig: Rig) -> dict[str, Any]:
    state, demand, allocation = cycle.state, cycle.demand, cycle.allocation
    none = np.full(rig.n, np.nan)
    return {
        "cycle": state.cycle,
        "time": state.time,
        "position": state.pose.position.tolist(),
        "rotation": _rotation(state.pose.rotation, rig.dimension).ravel().tolist(),
        "twist": state.twist.tolist(),
        "structure": state.structure.ravel().tolist(),
        "lengths": state.lengths.tolist(),
        "speeds": state.speeds.tolist(),
        "measured": state.tensions.tolist(),
        "ages": state.ages.tolist(),
        "active": state.active.tolist(),
        "states": state.states.tolist(),
        "faults": state.faults.tolist(),
        "limiters": state.limiters.tolist(),
        "last_sequence": state.last_sequence.tolist(),
        "delays": state.delays.tolist(),
        "thermal": state.thermal.tolist(),
        "upper_now": state.upper_now.tolist(),
        "desired": (none if demand.wrench is None else np.asarray(demand.wrench, dtype=np.float64)).tolist(),
        "solver_wrench": cycle.solver_wrench.tolist(),
        "impedances": _impedances(demand.impedances, rig),
        "commanded_brakes": [module.name in demand.brakes for module in rig.modules],
        "stop": bool(demand.stop),
        "chosen": allocation.tensions.tolist(),
        "rendered": allocation.wrench.tolist(),
        "residual": float(allocation.residual),
        "status": int(allocation.status),
        "scale": float(allocation.scale),
        "iterations": int(allocation.iterations),
        "separation": allocation.separation.tolist(),
        "fallback_used": bool(cycle.fallback_used),
        "commanded": cycle.commanded.tolist(),
        "sequences": cycle.sequences.tolist(),
        "start_delay": float(cycle.start_delay),
        "compute_time": float(cycle.compute_time),
    }


def _rotation(rotation: Floats | None, dimension: int) -> Floats:
    """A rotation as a matrix, whichever way `Rig.structure_matrix` takes it."""
    if rotation is None:
        return np.eye(dimension)
    if dimension == 2:
        c, s = np.cos(rotation), np.sin(rotation)
        return np.array([[c, -s], [s, c]])
    return np.asarray(rotation, dtype=np.float64)


def _impedances(impedances: Mapping[str, Impedance], rig: Rig) -> list[float]:
    none = [float("nan")] * len(IMPEDANCE)
    wanted = [impedances.get(module.name) for module in rig.modules]
    return [
        number
        for each in wanted
        for number in (none if each is None else [float(getattr(each, name)) for name in IMPEDANCE])
    ]


def decode(rows: list[bytes], rig: Rig) -> dict[str, NDArray[Any]]:
    """Return the columns that cycles in JSON make.

    Raises
    ------
    KeyError, TypeError, ValueError, OverflowError, RecursionError
        If one of them is no cycle of this rig.
    """
    parsed = [json.loads(row) for row in rows]
    length = sizes(rig)
    found = {}
    for name, column in COLUMNS.items():
        shape = tuple(length[dim] for dim in column.dims)
        if name in LATER_COLUMNS and not all(name in row for row in parsed):
            found[name] = np.full((len(rows), *shape), np.nan)
            continue
        key = name if all(name in row for row in parsed) else OLD_NAMES.get(name, name)
        values = np.array([row[key] for row in parsed], dtype=TYPES[name])
        if values.dtype.kind == "f" and (np.abs(values[np.isfinite(values)]) >= MAX_MAGNITUDE).any():
            raise ValueError(f"a number of {MAX_MAGNITUDE:g} or more in {name}")
        found[name] = values.reshape(len(rows), *shape)
    if not (np.isfinite(found["time"]).all() and np.isfinite(found["start_delay"]).all()):
        raise ValueError("a cycle without a time")
    if unknown := set(found["status"].tolist()) - {int(status) for status in Status}:
        raise ValueError(f"status {min(unknown)}")
    return found
