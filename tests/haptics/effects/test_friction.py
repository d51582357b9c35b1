"""Friction holds, gives way, and slides; pulled by a spring, it sticks and slips."""

import numpy as np
import pytest

from tensionlab.haptics.effects import Friction, Motion
from tensionlab.haptics.effects.friction import Bristle
from tests.support.motions import follow


def drawn(friction, step_length, steps, step=0.001):
    x = step_length * np.arange(steps)
    return -follow(friction, np.stack([x, 0 * x, 0 * x], axis=-1), step)[:, 0]


def test_it_holds_as_a_spring_below_the_static_limit():
    quiet = Friction(damping=0.0)
    force = drawn(quiet, 1e-5, 120)  # 1.2 mm: 0.48 N
    assert force == pytest.approx(400.0 * 1e-5 * np.arange(120))


def test_it_gives_way_at_the_static_and_slides_at_the_dynamic_limit():
    force = drawn(Friction(load=2.0, damping=0.0), 1e-5, 1000)
    assert force.max() == pytest.approx(2.0 * 0.5, rel=0.01)
    assert force[-1] == pytest.approx(2.0 * 0.35)


def test_at_rest_it_does_not_creep():
    friction = Friction()
    x = np.concatenate([np.linspace(0.0, 0.0005, 100), np.full(3000, 0.0005)])
    force = follow(friction, np.stack([x, 0 * x, 0 * x], axis=-1), 0.001)[:, 0]
    assert force[-1] == pytest.approx(-400.0 * 0.0005)
    assert force[-1000:] == pytest.approx(force[-1])


def test_it_resists_in_the_direction_of_motion():
    along = np.array([3.0, 4.0, 0.0]) / 5
    path = 1e-4 * np.arange(300)[:, None] * along
    assert follow(Friction(), path, 0.001)[-1] == pytest.approx(-0.35 * along)


def test_pulled_by_a_spring_it_sticks_and_slips():
    """1 kg drawn at 5 cm/s by 50 N/m under 10 N: it sticks until the spring is at 5 N, and swings about 3.5 N."""
    friction = Friction(load=10.0, stiffness=20_000.0, damping=60.0)
    mass, spring, speed, step = 1.0, 50.0, 0.05, 5e-4
    position, velocity, memory = np.zeros(3), np.zeros(3), None
    x, pull = [], []
    for k in range(24_000):
        force, memory, _ = friction.render(Motion(position, velocity, k * step, step), memory)
        pulled = spring * (speed * k * step - position[0])
        velocity = velocity + (force + np.array([pulled, 0.0, 0.0])) / mass * step
        position = position + velocity * step
        pull.append(pulled)
        x.append(position[0])
    pull, x = np.array(pull[5000:]), np.array(x[5000:])
    frequency = np.sqrt(spring / mass)
    swing = np.hypot(1.5, spring * speed / frequency)
    assert pull.max() == pytest.approx(3.5 + swing, rel=0.02)
    assert pull.min() == pytest.approx(3.5 - swing, rel=0.05)
    moving = (np.diff(x) / step > 0.02).astype(int)
    slips = np.flatnonzero(np.diff(moving) == 1)
    assert len(slips) >= 5
    slipping = (2 * np.pi - 2 * np.arcsin(1.5 / swing)) / frequency
    assert np.diff(slips) * step == pytest.approx(3.0 / (spring * speed) + slipping, rel=0.03)


def test_energy_is_exactly_accounted_for():
    """With the force of the step's end, f·dp is at least what the bristle stores more, under any load."""
    random = np.random.default_rng(1)
    friction = Friction()
    position = np.cumsum(random.normal(size=(3000, 3)) * 1e-3, axis=0)
    load = np.abs(random.normal(size=3000)) * 3
    memory, stored = None, 0.0
    for k in range(3000):
        before = position[k - 1] if k else position[0]
        done = friction.rub(Motion(position[k], np.zeros(3)), np.asarray(load[k]), None, memory)
        memory = done.memory
        now = friction.stiffness / 2 * memory.stretch @ memory.stretch
        assert -done.force @ (position[k] - before) >= now - stored - 1e-12
        stored = now


def test_a_batch_is_the_same_as_one_by_one():
    paths = np.cumsum(np.random.default_rng(2).normal(size=(50, 4, 3)) * 1e-3, axis=0)
    together = follow(Friction(), paths, 0.001)
    for which in range(4):
        assert follow(Friction(), paths[:, which], 0.001) == pytest.approx(together[:, which])


def test_what_it_remembers_is_what_it_was_given():
    done = Friction().render(Motion(np.zeros(3), np.zeros(3)))
    assert isinstance(done.memory, Bristle)
    assert not done.memory.sliding
