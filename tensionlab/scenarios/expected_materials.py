"""The expected feel of the five materials."""

from __future__ import annotations

import numpy as np

from tensionlab.arrays import Floats, angles
from tensionlab.haptics.effects import Magnet, Shape, Sphere, Texture, Vibration, Water
from tensionlab.haptics.effects.effect import Motion
from tensionlab.haptics.rendering.renderer import DELAY_CYCLES, HAND_DAMPING
from tensionlab.haptics.rendering.stability import capped, stiffness_cap
from tensionlab.scenarios.expected_values import Row, Touch, about, effect, pitch, rms, touch
from tensionlab.scenarios.play import Played

TOUCHED = 0.5
"""A force above, in N, is a touch."""
FELT = 0.15
"""What a ripple must push with to be felt, in N."""


def materials(played: Played) -> tuple[Row, ...]:
    """What each of the five feels like."""
    return (*magnetic(played), *textured(played), *shaped(played), *vibrating(played), *water(played))


def magnetic(played: Played) -> tuple[Row, ...]:
    """It draws the hand down by its largest force, as stiffly as the host may, and lets it go slowly."""
    magnet, begin, end = effect(played, Magnet)
    felt = touch(played).during(begin, end)
    height, speed = magnet.plane.height(felt.position), _speeds(felt) @ magnet.plane.n
    stiffness, wanted = ceiling(played, felt.time), np.zeros_like(height)
    for cap in np.unique(stiffness):
        there = stiffness == cap
        motion = Motion(felt.position[there], _speeds(felt)[there])
        wanted[there] = -capped(magnet, float(cap)).render(motion).force @ magnet.plane.n
    down, leaving = -felt.force @ magnet.plane.n, (height > 0.0) & (height < magnet.reach) & (speed > 0.01)
    return (
        about("magnet: largest pull", "N", float(wanted.max()), float(down[leaving].max(initial=0.0)), 0.2),
        Row("magnet: pull on the way off it, error", "N", 0.0, 0.5, rms((down - wanted)[leaving])),
    )


def textured(played: Played) -> tuple[Row, ...]:
    """Friction where the hand slides, and ripples of the right period, if the host may make them felt at all."""
    rough, begin, end = effect(played, Texture)
    felt = touch(played).during(begin, end)
    ripples = capped(rough.ripples, float(ceiling(played, felt.time).min()))
    normal, across = rough.wall.plane.n, np.asarray(ripples.direction)
    load, speed = felt.force @ normal, _speeds(felt) @ across
    slides = (load > TOUCHED) & (speed > 0.01)
    x, rub = felt.position[slides] @ across, -(felt.force @ across)[slides] / load[slides]
    # Against the way, not the time, the ripples are even; the mean is the friction.
    way = np.arange(x[0], x[-1], ripples.period / 50)
    along = np.interp(way, *_sorted(x, rub))
    rows = [about("rough: friction coefficient", "1", rough.friction.dynamic, float(along.mean()), 0.25)]
    if ripples.push(np.array(0.0), np.array(0.0), load[slides].mean(), 0.0) < -FELT:
        rows.append(about("rough: period of the ripples", "m", ripples.period, 1.0 / pitch(way, along), 0.15))
    return tuple(rows)


def shaped(played: Played) -> tuple[Row, ...]:
    """It pushes out of the ball, as stiffly as it should."""
    ball, begin, end = effect(played, Shape)
    assert isinstance(ball.field, Sphere)
    felt = touch(played).during(begin, end)
    out = felt.position - np.asarray(ball.field.centre)
    depth = ball.field.radius - np.linalg.norm(out, axis=1)
    push = np.einsum("kd,kd->k", felt.force, out) / np.linalg.norm(out, axis=1)
    pressed = (push > 2 * TOUCHED) & (np.abs(np.linalg.norm(_speeds(felt), axis=1)) < 0.15)
    off = angles(felt.force, out)
    stiffness = float(np.median(push[pressed] / depth[pressed]))
    return (
        about("ball: stiffness", "N/m", ball.coupling.stiffness, stiffness, 0.25),
        Row("ball: angle off the surface's normal, median", "deg", 0.0, 15.0, float(np.median(off[pressed]))),
    )


def vibrating(played: Played) -> tuple[Row, ...]:
    """It shakes with its frequency, by one newton; the cables stay taut."""
    hum, begin, end = effect(played, Vibration)
    felt = touch(played).during(begin + 0.3, end)
    shaking = felt.force @ (np.asarray(hum.axis) / np.linalg.norm(hum.axis))
    if played.felt is None:  # what modules say comes too seldom to see it
        return ()
    part = (played.felt.time >= begin + 0.3) & (played.felt.time < end)
    return (
        about("vibration: frequency", "Hz", hum.frequency, pitch(felt.time, shaking), 0.03),
        Row("vibration: amplitude", "N", 0.8, 1.25, float(np.sqrt(2.0) * np.std(shaking))),
        Row("vibration: least tension of a cable", "N", 0.01, 1.0, float(played.felt.tensions[part].min())),
    )


def water(played: Played) -> tuple[Row, ...]:
    """It drags, and lifts a hand at rest."""
    sea, begin, end = effect(played, Water)
    felt = touch(played).during(begin + 0.3, end)
    under = -sea.surface.height(felt.position) > sea.mixing
    speed = np.linalg.norm(_speeds(felt), axis=1)
    still, quick = under & (speed < 0.02), under & (speed > 0.2)
    way = _speeds(felt)[quick] / speed[quick, None]
    drag = -np.einsum("kd,kd->k", felt.force[quick] - sea.lift * sea.surface.n, way)
    wanted = sea.linear * speed[quick] + sea.quadratic * speed[quick] ** 2
    return (
        about(
            "water: lift of a hand at rest", "N", sea.lift, float((felt.force[still] @ sea.surface.n).mean()), 0.15
        ),
        about("water: drag, as a share of what it should be", "1", 1.0, float(drag.sum() / wanted.sum()), 0.15),
    )


def ceiling(played: Played, time: Floats) -> Floats:
    """How stiff could the host be at times, in N/m? By how late it had found the loop to be until then."""
    run, rate = played.run, played.scenario.rate
    late = np.nanmax(run.delays, axis=1, initial=0.0)
    worst = np.array([late[max(cycle + 1 - DELAY_CYCLES, 0) : cycle + 1].max() for cycle in range(len(run))])
    caps = {each: stiffness_cap(each, 1.0 / rate, HAND_DAMPING) for each in np.unique(worst)}
    cycles = np.searchsorted(run.time, time, side="right") - 1
    return np.array([caps[worst[max(cycle, 0)]] for cycle in cycles])


def _speeds(felt: Touch) -> Floats:
    speeds: Floats = np.gradient(felt.position, felt.time, axis=0)
    return speeds


def _sorted(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    order = np.argsort(x)
    return x[order], y[order]
