"""Pretension: slack cables are taken up before a run, at the minimum tension, and cables in disorder are named.

Between runs modules are idle, and cables hang as they were pulled out. A module measures what has left its spool,
so idle lengths are too long, and fix no pose before the cables are taut. Until the pose is known,

- each module pulls with its own minimum tension, 0.5 N unless it was set up otherwise, and none with more; the
  firmware pulls with that from ARM on. Cable leaves a spool only where it is pulled harder;
- set-points live as long as in the run. A host that dies or hangs, a lost module, Ctrl-C and an emergency stop end
  this as they end a run;
- a cable that is taken up further than the others let it holds nothing. All modules are stopped at once;
- cables that do not come to rest, and lengths that then fit no pose, end the run before any wrench is rendered.

Tensions go from the minimum to those of the first demand by the limit on their slew. The speed at which a spool
takes up slack is limited by its motor's voltage, some 2 m/s at 12 V, and the host cannot slow it down: as a
cable becomes taut, the spool's momentum is a tug of some 20 N for some 5 ms (simulated, on a platform that does
not move).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.settings import Clock
from tensionlab.hardware.runner.state_estimation import MAX_LENGTH_ERROR_M, Observation, PoseTracker, synchronise
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

WINDOW_S = 0.5  # time over which speeds are averaged: a hand may shake meanwhile, and telemetry be late
# A cable that gets shorter this fast on average is being taken up. A hand that starts a run is slower.
TAKE_UP_M_S = 0.5
REST_M_S = 0.05  # average speed below which a cable is at rest
MISFIT_S = 1.0  # lengths that fit no pose are refused once the cables have been at rest for this time
# Time without a cable that is taken up after which speeds need not fit a motion: a hand shakes, links are late.
SHAKING_S = 4.0
MAX_PRETENSION_S = 20.0  # longest time for cables to come to rest: 40 m of slack at 2 m/s
# Tolerance by which a cable may appear shorter than possible (two lengths are compared).
TOO_SHORT_M = 2.0 * MAX_LENGTH_ERROR_M
MAX_PLACE_ERROR_M = 0.5  # largest error of a position that is given in place of lengths
# Where the other lengths fit a pose better than this, the one that was left out explains why all fit none.
MAX_UNCERTAINTY_M = 0.01
WITHOUT_LENGTHS = "Or say where it is by `--at X Y Z`, in Python a tracker: then a run needs no lengths"
NOT_AT_REST = f"the cables have not come to rest within {MAX_PRETENSION_S:g} s"
HOLD_STILL = "see that all are hooked on and free, and hold the platform still"
SLACK = "Cables are slack, caught, or off their hooks: pull at each"
MEANINGS = {
    "long": "A cable is too long where it is slack or caught: pull at it, and see its spool turn",
    "short": "A cable is too short where it is off its hook, or its length was set elsewhere",
}


def take_up_slack(
    rig: Rig,
    cycle: Callable[[], Observation],
    active: NDArray[np.bool_],
    clock: Clock,
    tracker: PoseTracker | None,
    expected: Callable[[], Floats] | None = None,
) -> None:
    """Do cycles until no cable is taken up any more, and the tracker knows the pose by their lengths.

    `cycle` waits for the next cycle, commands the minimum tensions, and returns the observation. `active` (m,) has
    the modules that take part, and may change meanwhile. Without a tracker, `expected` returns the lengths by the
    place now, (m,) in m; NaN where a module does not know its own. Once all lengths are as expected, within
    `MAX_LENGTH_ERROR_M`, no cable is slack. A `HardwareError` names the modules whose cables are loose, do not
    come to rest, or fit no pose.
    """
    began, average = clock.now(), CableSpeeds()
    calm_since = rest_since = began
    while True:
        seen = cycle()
        now, lengths = clock.now(), synchronise(seen.lengths, seen.speeds, seen.ages)
        if expected is not None:
            by_place = expected()
            if (~active | (np.abs(lengths - by_place) <= MAX_LENGTH_ERROR_M)).all():
                return
            _require_held(rig, by_place - MAX_PLACE_ERROR_M, lengths, seen.speeds, active)
        elif tracker is not None:
            _require_held(rig, _shortest(rig, tracker, lengths, seen.speeds, active), lengths, seen.speeds, active)
        speeds = average.take(now, lengths)
        if speeds is None or (active & (speeds < -TAKE_UP_M_S)).any():
            calm_since = rest_since = now
        elif tracker is None:
            return
        else:
            tracker.search(lengths, active)
            if tracker.fits and (tracker.moves_as_one(speeds, active) or now - calm_since > SHAKING_S):
                return
            if tracker.fits or (active & (speeds < -REST_M_S)).any():
                rest_since = now
            if now - rest_since > MISFIT_S:
                raise HardwareError(explain_lengths(rig, tracker, lengths, active))
        if speeds is not None and now - began > MAX_PRETENSION_S:
            moving = [f'"{rig.modules[index].name}"' for index in np.flatnonzero(active & (speeds < -REST_M_S))]
            still = f"module {', '.join(moving) or 'none'} still reels in"
            raise HardwareError(f"{NOT_AT_REST} ({still}): {HOLD_STILL} until the run begins")


class CableSpeeds:
    """Average speeds of paying out over the last `WINDOW_S`."""

    def __init__(self) -> None:
        self._rows: deque[tuple[float, Floats]] = deque()

    def take(self, now: float, lengths: Floats) -> Floats | None:
        """Take the lengths (m,) in m at a time in s; return the speeds in m/s, None before the window is full."""
        self._rows.append((now, lengths))
        oldest = now - WINDOW_S + 1e-9
        while len(self._rows) > 2 and self._rows[1][0] <= oldest:
            self._rows.popleft()
        since, first = self._rows[0]
        return (lengths - first) / (now - since) if since <= oldest else None


def require_possible(rig: Rig, lengths: Floats) -> None:
    """Refuse, by a `HardwareError`, lengths (m,) in m too short for any pose, however slack cables are."""
    gaps = np.where(np.eye(rig.m, dtype=bool), 0.0, _gaps(rig))
    missing = gaps - lengths[:, None] - lengths[None, :]
    one, other = np.unravel_index(int(np.nanargmax(missing)), missing.shape)
    if missing[one, other] > TOO_SHORT_M:
        first, second = rig.modules[one].name, rig.modules[other].name
        raise HardwareError(
            f'the cables of modules "{first}" and "{second}" are {lengths[one]:.2f} and {lengths[other]:.2f} m '
            f"long, and need {gaps[one, other]:.2f} m together to meet. Slack makes a length longer, never "
            f"shorter: calibrate them (`tensionlab module calibrate lengths`). {WITHOUT_LENGTHS}"
        )


def explain_lengths(rig: Rig, tracker: PoseTracker, lengths: Floats, active: NDArray[np.bool_]) -> str:
    """Return which of the lengths (m,) in m explains that they fit no pose near home, and what to do.

    Each is left out in turn: if the others fit a pose, it is too long or too short for that one. With one cable
    more than unknowns, each of them explains it, and all by the same sign.
    """
    tracker.search(lengths, active)
    worst = rig.modules[tracker.worst].name
    reason = f'that of module "{worst}" is off most, by {tracker.off:.2f} m; no single one explains it. {SLACK}'
    causes: list[tuple[float, str, float]] = []  # error of the others, name and excess of a cable
    for index in np.flatnonzero(active).tolist():
        pose, _ = tracker.search(lengths, active & (np.arange(rig.m) != index))
        if tracker.fits:
            excess = float((lengths - rig.lengths(*pose))[index])
            causes.append((tracker.error, rig.modules[index].name, excess))
    tolerance = max(MAX_UNCERTAINTY_M, 2.0 * min(causes)[0]) if causes else 0.0
    likely = [(name, abs(by), "long" if by > 0.0 else "short") for error, name, by in causes if error <= tolerance]
    if likely:
        reason = ", or ".join(f'that of module "{name}" is {by:.2f} m too {word}' for name, by, word in likely)
        reason += "".join(f". {MEANINGS[word]}" for word in sorted({word for _, _, word in likely}))
    return f"cable lengths fit no pose: {reason}. {WITHOUT_LENGTHS}"


def _require_held(rig: Rig, shortest: Floats, lengths: Floats, speeds: Floats, active: NDArray[np.bool_]) -> None:
    """Refuse a cable that is being taken up though it is shorter than it can be, (m,) in m.

    Where two are, and are too short together, nothing tells which of them is loose: both are named.
    """
    loose = np.flatnonzero(active & (speeds < -TAKE_UP_M_S) & (lengths < shortest))
    if loose.size:
        names = " or ".join(f'"{rig.modules[index].name}"' for index in loose)
        reeled = " or ".join(f"{length:.2f}" for length in np.maximum(lengths[loose], 0.0))
        needed = " or ".join(f"{length:.2f}" for length in shortest[loose])
        why = f"is loose: it was reeled in to {reeled} m, where {needed} m or more would hold the platform"
        advice = "See that no one is in its way, hook it on, and start again"
        raise HardwareError(f"the cable of module {names} {why}. {advice}")


def _shortest(
    rig: Rig, tracker: PoseTracker, lengths: Floats, speeds: Floats, active: NDArray[np.bool_]
) -> Floats:
    """Return the shortest possible length of each cable, (m,) in m, as far as the lengths of the others tell."""
    gaps = _gaps(rig) - np.where(active, lengths, np.inf)
    shortest: Floats = gaps.max(axis=1, initial=0.0, where=~np.eye(rig.m, dtype=bool))
    resting: NDArray[np.bool_] = active & (np.abs(speeds) < REST_M_S)
    if rig.n <= np.count_nonzero(resting) == np.count_nonzero(active) - 1:
        pose, _ = tracker.search(lengths, resting)
        if tracker.fits:
            shortest = np.where(resting, shortest, np.maximum(shortest, rig.lengths(*pose)))
    return shortest - TOO_SHORT_M


def _gaps(rig: Rig) -> Floats:
    """Return the distance that two cables must span together at least, (m, m) in m, at any pose."""
    anchors, attachments = np.asarray(rig.anchors), np.asarray(rig.attachments)
    apart: Floats = np.linalg.norm(anchors[:, None] - anchors[None, :], axis=-1)
    on_platform: Floats = np.linalg.norm(attachments[:, None] - attachments[None, :], axis=-1)
    return apart - on_platform
