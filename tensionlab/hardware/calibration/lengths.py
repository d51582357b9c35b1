"""Cable lengths of a rig: their zero, and those of many poses as a person moves the handle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from tensionlab.errors import CalibrationError, HardwareError
from tensionlab.hardware.calibration.anchors import Poses
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.protocol.codes import Calibration
from tensionlab.hardware.runner.pretension import HOLD_STILL, MAX_PRETENSION_S, NOT_AT_REST, REST_M_S, CableSpeeds
from tensionlab.hardware.runner.settings import Clock
from tensionlab.hardware.runner.watchdog import stopping
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files.tables import read_table

PERIOD_S, TELEMETRY_MS = 0.02, 20
MAX_AGE_S = 0.5  # age of telemetry beyond which a module is silent
TAUT_S = 1.0  # shortest time for which cables are tightened before their length is set
RELEASE_S = 0.5  # time that a module takes to release
# A pose is recorded when no cable has moved by more than the first for the second, and one by the third since.
STILL_M, STILL_S, APART_M = 0.001, 0.4, 0.03
# Columns of a rotation: in the plane an angle, in space an axis times an angle, in rad.
ROTATION_COLUMNS = {1: ("angle",), 3: ("rx", "ry", "rz")}


def zero_lengths(group: ModuleGroup, rig: Rig, clock: Clock) -> Floats:
    """Set the cable lengths of all modules while the platform is held at the rig's home; return those before.

    Cables are pulled tight first. A module forgets its length at SAVE and when it restarts. The lengths before are
    (m,) in m; NaN where a module knew none. After an error all modules are stopped.
    """
    group.prepare(rig, TELEMETRY_MS)
    lengths = np.full(rig.m, np.nan)
    average, began, resting = CableSpeeds(), clock.now(), False

    def look() -> bool:
        nonlocal resting
        lengths[:] = _lengths(group)
        speeds = average.take(clock.now(), lengths.copy())
        resting = speeds is not None and bool((speeds > -REST_M_S).all())
        return not resting or clock.now() - began < TAUT_S

    _taut(group, rig, clock, MAX_PRETENSION_S, look)
    if not resting:
        raise CalibrationError(f"{NOT_AT_REST}: {HOLD_STILL}")
    known = [info.length_known for info in group.infos]
    clock.wait_until(clock.now() + RELEASE_S)
    for client, length in zip(group.clients, rig.lengths(rig.home, frames=rig.at_rest), strict=True):
        client.calibrate(Calibration.LENGTH, float(length))
    return np.where(known, lengths, np.nan)


def record_lengths(
    group: ModuleGroup,
    rig: Rig,
    clock: Clock,
    poses: int,
    seconds: float,
    found: Callable[[int], None] | None = None,
) -> Floats:
    """Record the cable lengths (K, m) in m at ``poses`` poses at which a person holds the platform still.

    The modules pull with the rig's lower limits, so that the cables are tight. A pose counts when all cables have
    been still for a while, and have other lengths than at each pose before: then `found` is called with the number
    of poses. It ends after `seconds` at the latest; after an error all modules are stopped.
    """
    group.prepare(rig, TELEMETRY_MS)
    group.require_lengths()
    rows: list[Floats] = []
    window: list[Floats] = []

    def look() -> bool:
        window.append(_lengths(group))
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
    for error in failed.values():
        raise error


def _lengths(group: ModuleGroup) -> Floats:
    lengths = []
    for client in group.clients:
        latest = client.telemetry
        if latest is None or client.link.clock() - latest.time > MAX_AGE_S:
            raise HardwareError(f'module "{client.name}" sends no telemetry')
        lengths.append(latest.message.length)
    return np.array(lengths)


def columns(rig: Rig, lengths: Floats) -> dict[str, Floats]:
    """Return a table of lengths with a column for each module, as `load_lengths` reads them."""
    return {module.name: lengths[:, index] for index, module in enumerate(rig.modules)}


def load_lengths(path: str | Path, rig: Rig) -> tuple[Floats, Poses | None]:
    """Return the lengths of a CSV file, and the poses if it has them; a `CalibrationError` says what is wrong.

    It has a column of lengths, in m, for each module, by its name; and perhaps ``x``, ``y`` and ``z`` of the
    reference point in m, and of the rotation ``angle`` (planar) or ``rx``, ``ry`` and ``rz`` (axis times angle),
    in rad.
    """
    names = [module.name for module in rig.modules]
    axes, turns = tuple("xyz"[: rig.dimension]), ROTATION_COLUMNS.get(rig.n - rig.dimension, ())
    table = read_table(path, names, (*axes, *turns), error=CalibrationError)
    lengths = np.column_stack([table[name] for name in names])
    given = set(table) - set(names)
    if not given:
        return lengths, None
    if given not in (set(axes), {*axes, *turns}):
        raise CalibrationError(f"{path}: a pose has the columns {', '.join((*axes, *turns))}; give all, or none")
    position = np.column_stack([table[axis] for axis in axes])
    if not turns or turns[0] not in table:
        return lengths, Poses.at(rig, position)
    return lengths, Poses.at(rig, position, np.column_stack([table[turn] for turn in turns]))
