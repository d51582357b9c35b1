"""The expected feel of each scenario of this package.

Forces differ noticeably by some 7 per cent at 2.5 to 10 N. What the host renders is that much late, and no stiffer
than the loop allows: bounds follow the delay that was found. All of them are this project's own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tensionlab.arrays import angles
from tensionlab.haptics.effects import Bow, Recoil, Weight
from tensionlab.haptics.effects.effect import Motion
from tensionlab.scenarios.expected_collision import collision
from tensionlab.scenarios.expected_materials import materials
from tensionlab.scenarios.expected_values import (
    NOTICEABLE,
    Row,
    about,
    between,
    effect,
    first,
    late,
    pitch,
    rms,
    touch,
)
from tensionlab.scenarios.play import Played

SETTLED = 0.3
"""What is felt before, in s, is the modules coming up."""
LOCKING = 0.1
"""How long a brake takes to lock, in s."""
KICK = 0.3
"""How long a shot is felt, in s: five time constants."""


def expected(played: Played) -> tuple[Row, ...]:
    """What should a scenario have felt like, and what did it? None for a scenario that is not of this package."""
    judge = EXPECTED.get(played.scenario.name)
    return () if judge is None else judge(played)


def recoil(played: Played) -> tuple[Row, ...]:
    """The impulse and the peak of the shots, and where they kick.

    All beyond what keeps the cables taut: nobody feels that as a kick.
    """
    pistol, _, _ = effect(played, Recoil)
    felt, way = touch(played), np.asarray(pistol.direction) / np.linalg.norm(pistol.direction)
    shares, peaks, off = [], [], []
    shots = [shot for shot in pistol.shots if shot + KICK < felt.time[-1]]
    for shot, following in zip(shots, [*shots[1:], np.inf], strict=True):
        before = felt.during(shot - 0.1, shot)
        after = felt.during(shot, min(shot + KICK, following))
        taut = before.force.mean(axis=0)
        force = after.force - taut
        along = force @ way
        wanted = pistol.render(Motion(after.position, 0.0 * after.position, after.time)).force @ way
        shares.append(
            np.trapezoid(along, after.time) / np.trapezoid(np.maximum(wanted - taut @ way, 0.0), after.time)
        )
        peaks.append(float(along.max()))
        off.append(float(angles(way[None], force[[int(np.argmax(along))]])[0]))
    return (
        Row("impulse of a shot, as a share of what it should be", "1", 0.75, 1.1, float(np.mean(shares))),
        Row("peak of a shot, on average", "N", 0.6 * pistol.peak, pistol.peak, float(np.mean(peaks))),
        Row("largest angle between kick and its direction", "deg", 0.0, 45.0, float(np.max(off))),
    )


def weight(played: Played) -> tuple[Row, ...]:
    """Gravity and inertia of what is lifted; a box that does not come up, but may go down."""
    held, _, _ = effect(played, Weight)
    felt, path = touch(played), played.scenario.person.script.waypoints
    down = -felt.force[:, 2]
    lift = between(felt.time, path[0].time, path[1].time)
    rest = between(felt.time, path[1].time + SETTLED, path[2].time)
    gravity = -held.mass * held.gravity[2]
    height, seconds = path[1].position[2] - path[0].position[2], path[1].time - path[0].time
    most = gravity + held.mass * min(5.77 * height / seconds**2, held.limit)  # of the way with the least jerk
    above = 1.12 if played.felt is not None else 1.12 + NOTICEABLE  # a tracked speed is known less well
    rows = [
        about("weight of what is held still", "N", gravity, float(down[rest].mean())),
        Row("largest force while it is lifted", "N", 0.88 * most, above * most, float(down[lift].max())),
        Row("sideways force meanwhile", "N", 0.0, 0.5, float(np.linalg.norm(felt.force[lift, :2], axis=1).max())),
    ]
    locked = played.run.time[played.run.commanded_brakes.any(axis=1)]
    if played.felt is not None and locked.size:
        box = between(felt.time, locked[0] + LOCKING, locked[-1])
        freed = between(felt.time, locked[-1] + 0.2, felt.time[-1])
        rows += [
            Row("largest force under the box", "N", 40.0, 70.0, float(down[box].max())),
            Row("how far the box comes up", "m", 0.0, 0.02, float(np.ptp(felt.position[box, 2]))),
            Row("largest force once it is put down", "N", 0.0, 8.0, float(down[freed].max())),
        ]
    return tuple(rows)


def bow(played: Played) -> tuple[Row, ...]:
    """Force and energy against the draw; a stop at its end; a string that is loosed, and hums."""
    string, _, _ = effect(played, Bow)
    felt = touch(played)
    far = np.linalg.norm(felt.position, axis=1)
    pull = -np.einsum("kd,kd->k", felt.force, felt.position) / far
    locked = played.run.time[played.run.commanded_brakes.any(axis=1)]
    begin, end = (float(locked[0]), float(locked[-1])) if locked.size else (string.loosed, string.loosed)
    drawing = between(felt.time, SETTLED, begin)
    draw = np.maximum(far - string.brace, 0.0)
    wanted = string.pull(draw)
    work = float(np.trapezoid(pull[drawing], draw[drawing]))
    energy = float(np.trapezoid(wanted[drawing], draw[drawing]))
    gone = between(felt.time, string.loosed, string.loosed + 5.0 * string.fade)
    fallen = first(felt.time[gone], pull[gone] < string.slack + 2.0 * string.hum)
    humming = gone & (felt.time > string.loosed + fallen)
    rows = [
        Row("force against the draw, root mean square error", "N", 0.0, 0.3, rms(pull[drawing] - wanted[drawing])),
        about("work of the draw", "J", energy, work),
        Row("time from the loose to a slack string", "s", 0.0, 0.04 + late(played), fallen),
    ]
    if played.felt is not None:  # what modules say comes too seldom to hear it
        hum = pitch(felt.time[humming], pull[humming])
        rows.append(Row("hum", "Hz", 0.9 * string.frequency, 1.1 * string.frequency, hum))
    held = between(felt.time, begin + LOCKING, end)
    if played.felt is not None and held.any():
        give = float(np.ptp(far[held & (pull > string.most)]))
        rows += [
            Row("largest force at the stop", "N", 40.0, 65.0, float(pull[held].max())),
            Row("give of the stop under it", "m", 0.0, 0.025, give),
        ]
    return tuple(rows)


EXPECTED: dict[str, Callable[[Played], tuple[Row, ...]]] = {
    "materials": materials,
    "collision": collision,
    "recoil": recoil,
    "weight": weight,
    "bow": bow,
}
"""By the scenario's name."""
