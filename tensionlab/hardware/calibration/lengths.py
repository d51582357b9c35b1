"""Cable lengths of a rig: their zero, and those of many poses as a person moves the handle."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from tensionlab.errors import CalibrationError, HardwareError
from tensionlab.hardware.calibration.anchor_fit import Poses, rotations
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.protocol.codes import Calibration
from tensionlab.hardware.protocol.messages import Telemetry
from tensionlab.hardware.runner.pretension import MAX_PRETENSION_S, REST_M_S, CableSpeeds
from tensionlab.hardware.runner.settings import Clock
from tensionlab.hardware.runner.watchdog import stopping
from tensionlab.model.module import KINDS
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files.tables import read_table

PERIOD_S = 0.02
# Shortest time cables are tightened before their length is set, and time a module takes to release, in
# s.
TAUT_S, LOOSE_S = 1.0, 0.5
# A pose: no cable moves by more than the first (m) for the second (s); it differs by the third from each pose.
STILL_M, STILL_S, APART_M = 0.001, 0.4, 0.03
AXES = "xyz"
# Columns of a rotation: in the plane an angle, in space an axis times an angle, in rad.
TURNS = {1: ("angle",), 3: ("rx", "ry", "rz")}


def zero_lengths(group: ModuleGroup, rig: Rig, clock: Clock) -> Floats:
    """Set the cable lengths of all modules while the platform is held at the rig's home; return those before.

    Cables are pulled tight first. A module forgets its length at SAVE and when it restarts. The lengths before are
    (m,) in m; NaN where a module knew none. After an error all modules are stopped.
    """
    group.prepare(rig, 20)
    before = np.full(rig.m, np.nan)

    average, began, resting = CableSpeeds(), clock.now(), False

    def look() -> bool:
        nonlocal resting
        before[:] = [each.length for each in _telemetry(group)]
        speeds = average.take(clock.now(), before.copy())
        resting = speeds is not None and bool((speeds > -REST_M_S).all())
        return not resting or clock.now() - began < TAUT_S

    _taut(group, rig, clock, MAX_PRETENSION_S, look)
    if not resting:
        raise CalibrationError(
            f"the cables have not come to rest within {MAX_PRETENSION_S:g} s; see that all are hooked on and "
            "free, and hold the platform still"
        )
    known = [info.length_known for info in group.infos]
    clock.wait_until(clock.now() + LOOSE_S)
    for client, length in zip(group.clients, rig.lengths(rig.home, frames=rig.at_rest), strict=True):
        client.calibrate(Calibration.LENGTH, float(length))
    return np.where(known, before, np.nan)


def record_lengths(
    group: ModuleGroup,
    rig: Rig,
    clock: Clock,
    poses: int,
    seconds: float,
    found: Callable[[int], None] | None = None,
) -> Floats:
    """Record the cable lengths (K, m) in m of ``poses`` poses, wherever a person holds the platform still.

    The modules pull with the rig's lower limits, so that the cables are tight. A pose counts when all cables have
    been still for a while, and have other lengths than at each pose before: then `found` is called with the number
    of poses. It ends after `seconds` at the latest; after an error all modules are stopped.
    """
    group.prepare(rig, 20)
    group.require_lengths()
    rows: list[Floats] = []
    window: list[Floats] = []

    def look() -> bool:
        window.append(np.array([each.length for each in _telemetry(group)]))
        del window[: -round(STILL_S / PERIOD_S)]
        if len(window) < round(STILL_S / PERIOD_S) or np.ptp(window, axis=0).max() > STILL_M:
            return True
        row = np.mean(window, axis=0)
        if all(np.abs(row - other).max() > APART_M for other in rows):
            rows.append(row)
            if found:
                found(len(rows))
        return len(rows) < poses

    _taut(group, rig, clock, seconds, look)
    if not rows:
        raise CalibrationError(
            f"the cables were never still for {STILL_S} s; hold the platform still at each pose"
        )
    return np.array(rows)


def _taut(group: ModuleGroup, rig: Rig, clock: Clock, seconds: float, look: Callable[[], bool]) -> None:
    """Pull with the lower limits until `look`, called every period, has seen enough; stop all in any case."""
    with stopping(lambda: _raise(group.stop()), lambda: _raise(group.emergency_stop())):
        group.arm(rig.limits.lower)
        now, end = clock.now(), clock.now() + seconds
        while now < end:
            for client, tension in zip(group.clients, rig.limits.lower, strict=True):
                client.set_tension(float(tension))
            now += PERIOD_S
            clock.wait_until(now)
            for client in group.clients:
                client.listen()
                client.check()
            if not look():
                break


def _raise(failed: Mapping[str, HardwareError]) -> None:
    """Raise the error of a module that did not confirm its stop."""
    for error in failed.values():
        raise error


def _telemetry(group: ModuleGroup) -> Sequence[Telemetry]:
    reports = []
    for client in group.clients:
        heard = client.telemetry
        if heard is None or client.link.clock() - heard.time > 0.5:
            raise HardwareError(f'module "{client.name}" sends no telemetry')
        reports.append(heard.message)
    return reports


def columns(rig: Rig, lengths: Floats) -> dict[str, Floats]:
    """Return a table of lengths, a column a module, as `load_lengths` reads them."""
    return {module.name: lengths[:, index] for index, module in enumerate(rig.modules)}


def load_lengths(path: str | Path, rig: Rig) -> tuple[Floats, Poses | None]:
    """Return the lengths of a CSV file, and the poses if it has them; a `CalibrationError` says what is wrong.

    It has a column of lengths, in m, for each module, by its name; and perhaps ``x``, ``y`` and ``z`` of the
    reference point in m, and of the rotation ``angle`` (planar) or ``rx``, ``ry`` and ``rz`` (axis times angle),
    in rad.
    """
    names = [module.name for module in rig.modules]
    axes, turns = tuple(AXES[: rig.dimension]), TURNS.get(rig.n - rig.dimension, ())
    table = read_table(path, names, (*axes, *turns), error=CalibrationError)
    lengths = np.column_stack([table[name] for name in names])
    if not any(name in table for name in (*axes, *turns)):
        return lengths, None
    for group in (axes, turns):
        there = [name for name in group if name in table]
        if (there and len(there) < len(group)) or not all(axis in table for axis in axes):
            raise CalibrationError(
                f"{path}: a pose has the columns {', '.join((*axes, *turns))}; give all, or none"
            )
    position = np.column_stack([table[axis] for axis in axes])
    if not turns or turns[0] not in table or not KINDS[rig.kind].has_orientation:
        return lengths, Poses.at(rig, position)
    return lengths, Poses.at(rig, position, rotations(np.column_stack([table[turn] for turn in turns])))
