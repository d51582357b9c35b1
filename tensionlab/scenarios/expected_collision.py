"""The expected feel of scenario B: a cue, a stop, a free withdrawal, and no stop for what is too fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.haptics.effects.contact import Plane, Wall
from tensionlab.scenarios import Hold, Scenario
from tensionlab.scenarios.expected_values import Row, Touch, late, touch
from tensionlab.scenarios.play import Played

AWAY = 0.002
"""How far a head has come back when it withdraws, in m."""
FREE = 0.2
"""How soon it is free then, in s: a release, and the pawl on its way up."""
UNSURE = 0.1
"""How well the speed of a tracked head is known, in m/s: brakes may be locked so much the earlier."""


def collision(played: Played) -> tuple[Row, ...]:
    """How hard is the cue, where is the head stopped, how soon is it free, and what is too fast for the brakes?

    What a brake holds only a simulated person can tell.
    """
    hold, wall = hold_of(played.scenario)
    felt = touch(played)
    push, depth = felt.force @ wall.n, -wall.height(felt.position)
    begin, end = _locked(played)
    warned = push[felt.time < begin]
    leaning = (felt.time > begin) & (felt.time < end)
    refused, speed = _refused(played, felt.time, depth)
    early = 0.0 if played.felt is not None else UNSURE * hold.late_by(late(played)).latency
    cue = sum(
        each.stiffness
        for phase in played.scenario.phases
        for each in phase.effects.values()
        if isinstance(each, Wall)
    )
    rows = [
        Row("cue before the stop", "N", 1.5 - cue * early, 2.5, _most(warned)),
        Row("depth of the stop in the wall", "m", -0.015 - early, 0.01, _most(depth[leaning])),
        Row("speed of an approach that is refused", "m/s", 0.3, 2.0, speed),
    ]
    if played.felt is not None and hold.cap is not None:
        middle = (felt.time > begin + 0.25 * (end - begin)) & (felt.time < end - 0.25 * (end - begin))
        rows[2:2] = [
            Row("force of the wall while it leans", "N", 30.0, 40.0, _mean(push[middle])),
            Row("time until it is free again", "s", 0.0, FREE, _freed(played, felt, depth, begin, end)),
        ]
        sizes = np.linalg.norm(felt.force, axis=1)
        rows += [
            Row("largest force after that", "N", 0.0, 15.0, _most(sizes[felt.time >= refused])),
            Row("largest force at all", "N", 0.0, hold.cap.force, _most(sizes)),
        ]
    return tuple(rows)


def hold_of(scenario: Scenario) -> tuple[Hold, Plane]:
    """Which wall do brakes hold in a scenario?"""
    for phase in scenario.phases:
        if phase.hold is not None and phase.hold.plane is not None:
            return phase.hold, phase.hold.plane
    raise LookupError(f"{scenario.name} has no hold with a plane")


def _locked(played: Played) -> tuple[float, float]:
    """When were brakes locked for the first time, and until when? Infinite if they never were."""
    run = played.run
    locked: NDArray[np.bool_] = np.asarray(run.commanded_brakes.any(axis=1))
    if not locked.any():
        return np.inf, np.inf
    first = int(np.argmax(locked))
    rest = np.flatnonzero(~locked[first:])
    return float(run.time[first]), float(run.time[first + rest[0] if rest.size else -1])


def _refused(played: Played, time: Floats, depth: Floats) -> tuple[float, float]:
    """When was it first too fast, and how fast was it, in s and m/s?"""
    for event in played.run.events:
        if event.kind == "brake" and event.text == "too fast":
            return event.time, float(np.interp(event.time, time, np.gradient(depth, time)))
    return np.inf, float("nan")


def _freed(played: Played, felt: Touch, depth: Floats, begin: float, end: float) -> float:
    """How long do cables hold it once it withdraws, in s?"""
    assert played.felt is not None
    leaning = (felt.time > begin) & (felt.time < end)
    if not leaning.any():
        return float("nan")
    back = felt.time[leaning & (depth > depth[leaning].max() - AWAY)][-1]
    held = (played.felt.tensions > played.scenario.rig.limits.upper).any(axis=1)
    soon = held & (felt.time > back) & (felt.time < back + 1.0)
    return float(felt.time[soon][-1] - back) if soon.any() else 0.0


def _most(values: Floats) -> float:
    return float(values.max()) if values.size else float("nan")


def _mean(values: Floats) -> float:
    return float(values.mean()) if values.size else float("nan")
