"""Expected values of each scenario of this package, checked against the rendered force.

The just noticeable difference of forces is some 7 per cent at 2.5 to 10 N. The host's forces lag by the loop's
delay, which also limits their stiffness: bounds follow the measured delay. All bounds are this project's own. They
are in addition to `scenario_fidelity`, which judges every effect.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tensionlab.haptics.effects import Bow, Recoil, Texture, Vibration, Weight
from tensionlab.haptics.effects.contact import Plane, Wall
from tensionlab.haptics.effects.effect import Motion
from tensionlab.haptics.rendering.fidelity import rms
from tensionlab.haptics.rendering.stability import cap_stiffness, stiffness_cap
from tensionlab.model.wall_stiffness import HAND_DAMPING
from tensionlab.scenarios.checks import (
    LOCKING_S,
    NOTICEABLE,
    Check,
    ForceRecord,
    between,
    check_near,
    dominant_frequency,
    find_effect,
    loop_delay,
    maximum,
    rendered_force,
)
from tensionlab.scenarios.play import ScenarioResult
from tensionlab.scenarios.scenario import BrakeTarget, Scenario
from tensionlab.support.arrays import Floats, angles

START_S = 0.3  # start-up time of modules, which does not count
SHOT_S = 0.3  # duration of a shot: five time constants
WITHDRAWN_M = 0.002  # distance from the deepest position at which a head withdraws
RELEASE_S = 0.2  # longest time until it is free: the release, and the motion of the pawl
SPEED_ERROR = 0.1  # error of the speed of a tracked head, in m/s, by which brakes may lock earlier
TOUCH_N = 0.5  # smallest force of a touch
RIPPLE_N = 0.15  # force that makes a ripple perceptible


def check_scenario(result: ScenarioResult) -> tuple[Check, ...]:
    """Check the rendered forces; no checks for scenarios that are not of this package."""
    return tuple(each for check in EXPECTED.get(result.scenario.name, ()) for each in check(result))


def check_recoil(result: ScenarioResult) -> tuple[Check, ...]:
    """Check impulse, peak and direction of the shots, without the force of taut cables."""
    pistol, _ = find_effect(result, Recoil)
    rendered, way = rendered_force(result), np.asarray(pistol.direction) / np.linalg.norm(pistol.direction)
    shares, peaks, off = [], [], []
    shots = [shot for shot in pistol.shots if shot + SHOT_S < rendered.time[-1]]
    for shot, following in zip(shots, [*shots[1:], np.inf], strict=True):
        taut = rendered.during(shot - 0.1, shot).force.mean(axis=0)
        after = rendered.during(shot, min(shot + SHOT_S, following))
        force = after.force - taut
        along = force @ way
        wanted = pistol.render(Motion(after.position, 0.0 * after.position, after.time)).force @ way
        shares.append(
            np.trapezoid(along, after.time) / np.trapezoid(np.maximum(wanted - taut @ way, 0.0), after.time)
        )
        peaks.append(float(along.max()))
        off.append(float(angles(way[None], force[[int(np.argmax(along))]])[0]))
    return (
        Check("impulse of a shot, as a share of what it should be", "1", 0.75, 1.1, float(np.mean(shares))),
        Check("peak of a shot, on average", "N", 0.6 * pistol.peak, pistol.peak, float(np.mean(peaks))),
        Check("largest angle between kick and its direction", "deg", 0.0, 45.0, float(np.max(off))),
    )


def check_weight(result: ScenarioResult) -> tuple[Check, ...]:
    """Check gravity and inertia of the weight, and a box that brakes hold down."""
    held, _ = find_effect(result, Weight)
    rendered, path = rendered_force(result), result.scenario.person.script.waypoints
    gravity = held.mass * float(np.linalg.norm(held.gravity))
    up = -held.mass * np.array(held.gravity) / gravity
    down = -rendered.force @ up
    lift = between(rendered.time, path[0].time, path[1].time)
    rest = between(rendered.time, path[1].time + START_S, path[2].time)
    height, seconds = float(up @ np.subtract(path[1].position, path[0].position)), path[1].time - path[0].time
    peak = gravity + held.mass * min(5.77 * height / seconds**2, held.limit)  # motion with minimum jerk
    above = 1.12 if result.person is not None else 1.12 + NOTICEABLE  # a tracked speed is less accurate
    checks = [
        check_near("weight of what is held still", "N", gravity, float(down[rest].mean())),
        Check("largest force while it is lifted", "N", 0.88 * peak, above * peak, float(down[lift].max())),
    ]
    locked = result.run.time[result.run.commanded_brakes.any(axis=1)]
    if result.person is not None and locked.size:
        box = between(rendered.time, locked[0] + LOCKING_S, locked[-1])
        freed = between(rendered.time, locked[-1] + 0.2, rendered.time[-1])
        checks += [
            Check("largest force under the box", "N", 40.0, 70.0, float(down[box].max())),
            Check("how far the box comes up", "m", 0.0, 0.02, float(np.ptp(rendered.position[box] @ up))),
            Check("largest force once it is put down", "N", 0.0, 8.0, float(down[freed].max())),
        ]
    return tuple(checks)


def check_bow(result: ScenarioResult) -> tuple[Check, ...]:
    """Check force and energy of the draw, the stop at its end, and the released string."""
    string, _ = find_effect(result, Bow)
    rendered = rendered_force(result)
    far = np.linalg.norm(rendered.position, axis=1)
    pull = -np.einsum("kd,kd->k", rendered.force, rendered.position) / far
    locked = result.run.time[result.run.commanded_brakes.any(axis=1)]
    begin, end = (float(locked[0]), float(locked[-1])) if locked.size else (string.loosed, string.loosed)
    drawing = between(rendered.time, START_S, begin)
    draw = np.maximum(far - string.brace, 0.0)
    wanted = string.pull(draw)
    work = float(np.trapezoid(pull[drawing], draw[drawing]))
    energy = float(np.trapezoid(wanted[drawing], draw[drawing]))
    gone = between(rendered.time, string.loosed, string.loosed + 5.0 * string.fade)
    slack = rendered.time[gone & (pull < string.slack + 2.0 * string.hum)]
    slack_after = float(slack[0] - rendered.time[gone][0]) if slack.size else float("nan")
    error = rms(pull[drawing] - wanted[drawing])
    checks = [
        Check("force against the draw, root mean square error", "N", 0.0, 0.3, error),
        check_near("work of the draw", "J", energy, work),
        Check("time from the loose to a slack string", "s", 0.0, 0.04 + loop_delay(result), slack_after),
    ]
    held = between(rendered.time, begin + LOCKING_S, end)
    if result.person is not None and held.any():
        give = float(np.ptp(far[held & (pull > string.most)]))
        checks += [
            Check("largest force at the stop", "N", 40.0, 65.0, float(pull[held].max())),
            Check("give of the stop under it", "m", 0.0, 0.025, give),
        ]
    return tuple(checks)


def check_collision(result: ScenarioResult) -> tuple[Check, ...]:
    """Check cue, stop and release of the brakes, and their refusal of a fast head.

    The force of a brake is known for a simulated person only.
    """
    target, wall = find_brake_wall(result.scenario)
    rendered = rendered_force(result)
    push, depth = rendered.force @ wall.n, -wall.height(rendered.position)
    locks: NDArray[np.bool_] = np.asarray(result.run.commanded_brakes.any(axis=1))
    changes = np.flatnonzero(np.diff(locks, prepend=False, append=False))  # of the first approach, then of others
    begin, end = result.run.time[np.minimum(changes[:2], len(locks) - 1)] if changes.size else (np.inf, np.inf)
    leaning = (rendered.time > begin) & (rendered.time < end)
    refused, speed = _first_refusal(result, rendered.time, depth)
    early = 0.0 if result.person is not None else SPEED_ERROR * target.delayed_timing(loop_delay(result)).latency
    effects = [effect for phase in result.scenario.phases for effect in phase.effects.values()]
    cue = sum(effect.stiffness for effect in effects if isinstance(effect, Wall))
    checks = [
        Check("cue before the stop", "N", 1.5 - cue * early, 2.5, maximum(push[rendered.time < begin])),
        Check("depth of the stop in the wall", "m", -0.015 - early, 0.01, maximum(depth[leaning])),
        Check("speed of an approach that is refused", "m/s", 0.3, 2.0, speed),
    ]
    if result.person is not None and target.cap is not None:
        quarter = 0.25 * (end - begin)
        middle = push[(rendered.time > begin + quarter) & (rendered.time < end - quarter)]
        push_held = float(middle.mean()) if middle.size else float("nan")
        held = np.any(result.person.tensions > result.scenario.rig.limits.upper, axis=1)
        free_after = _release_time(rendered.time, depth, leaning, held)
        sizes = np.linalg.norm(rendered.force, axis=1)
        checks[2:2] = [
            Check("force of the wall while it leans", "N", 30.0, 40.0, push_held),
            Check("time until it is free again", "s", 0.0, RELEASE_S, free_after),
        ]
        checks += [
            Check("largest force after that", "N", 0.0, 15.0, maximum(sizes[rendered.time >= refused])),
            Check("largest force at all", "N", 0.0, target.cap.force, maximum(sizes)),
        ]
    return tuple(checks)


def find_brake_wall(scenario: Scenario) -> tuple[BrakeTarget, Plane]:
    """Return the first brake target with a plane, and the plane."""
    for phase in scenario.phases:
        if phase.hold is not None and phase.hold.plane is not None:
            return phase.hold, phase.hold.plane
    raise LookupError(f"{scenario.name} has no hold with a plane")


def _first_refusal(result: ScenarioResult, time: Floats, depth: Floats) -> tuple[float, float]:
    """Return the time of the first approach that was too fast, and its speed, in s and m/s."""
    for event in result.run.events:
        if event.kind == "brake" and event.text == "too fast":
            return event.time, float(np.interp(event.time, time, np.gradient(depth, time)))
    return np.inf, float("nan")


def _release_time(time: Floats, depth: Floats, leaning: NDArray[np.bool_], held: NDArray[np.bool_]) -> float:
    """Return how long cables are held after the head withdraws, in s."""
    if not leaning.any():
        return float("nan")
    back = time[leaning & (depth > depth[leaning].max() - WITHDRAWN_M)][-1]
    soon = held & (time > back) & (time < back + 1.0)
    return float(time[soon][-1] - back) if soon.any() else 0.0


def check_texture(result: ScenarioResult) -> tuple[Check, ...]:
    """Check friction of a sliding hand, and the period of ripples if the host can make them perceptible."""
    rough, rendered = find_effect(result, Texture)
    ripples, _ = cap_stiffness(rough.ripples, host_stiffness_limit(result, rendered))
    normal, across = rough.wall.plane.n, np.asarray(ripples.direction)
    load, speed = rendered.force @ normal, rendered.velocity @ across
    slides = (load > TOUCH_N) & (speed > 0.01)
    if not slides.any():
        return (check_near("rough: friction coefficient", "1", rough.friction.dynamic, float("nan"), 0.25),)
    x, friction = rendered.position[slides] @ across, -(rendered.force @ across)[slides] / load[slides]
    # Ripples are even by position, not by time; the mean is the friction.
    way, order = np.arange(x[0], x[-1], ripples.period / 50), np.argsort(x)
    along = np.interp(way, x[order], friction[order])
    checks = [check_near("rough: friction coefficient", "1", rough.friction.dynamic, float(along.mean()), 0.25)]
    if ripples.push(np.array(0.0), np.array(0.0), load[slides].mean(), 0.0) < -RIPPLE_N:
        period = 1.0 / dominant_frequency(way, along)
        checks.append(check_near("rough: period of the ripples", "m", ripples.period, period, 0.15))
    return tuple(checks)


def check_vibration(result: ScenarioResult) -> tuple[Check, ...]:
    """Check frequency and amplitude, and that the cables stay taut; telemetry is too slow to show it."""
    hum, rendered = find_effect(result, Vibration, START_S)
    if result.person is None:
        return ()
    shaking = rendered.force @ (np.asarray(hum.axis) / np.linalg.norm(hum.axis))
    tensions = result.person.tensions[np.isin(result.person.time, rendered.time)]
    frequency = dominant_frequency(rendered.time, shaking)
    return (
        check_near("vibration: frequency", "Hz", hum.frequency, frequency, 0.03),
        Check("vibration: amplitude", "N", 0.8, 1.25, float(np.sqrt(2.0) * np.std(shaking))),
        Check("vibration: smallest tension of a cable", "N", 0.01, 1.0, float(tensions.min())),
    )


def host_stiffness_limit(result: ScenarioResult, during: ForceRecord) -> float:
    """Return the host stiffness limit, in N/m, by the largest delay that was measured until a part ended."""
    delays = result.run.delays[result.run.time <= during.time[-1]]
    return stiffness_cap(float(np.nanmax(delays, initial=0.0)), 1.0 / result.scenario.rate, HAND_DAMPING)


EXPECTED: dict[str, tuple[Callable[[ScenarioResult], tuple[Check, ...]], ...]] = {
    "materials": (check_texture, check_vibration),
    "collision": (check_collision,),
    "recoil": (check_recoil,),
    "weight": (check_weight,),
    "bow": (check_bow,),
}  # checks by the scenario's name
