"""Walls, magnets, friction and textures push, pull and rub as their equations say."""

import numpy as np
import pytest

from tensionlab.haptics.effects import Friction, Magnet, Motion, Plane, Ripples, Texture, Wall
from tests.helpers.motions import at, follow


def height(effect, *heights, speed=0.0):
    z = np.array(heights, dtype=float)
    zero = np.zeros_like(z)
    motion = Motion(np.stack([zero, zero, z], -1), np.stack([zero, zero, zero + speed], -1))
    return effect.render(motion).force[..., 2]


def test_wall_damps_on_the_way_in_and_never_pulls():
    assert height(Wall(), -0.01, speed=-0.5) == pytest.approx(4.0)
    assert height(Wall(), -0.01, speed=0.5) == pytest.approx(2.0)
    assert height(Wall(), -0.01, speed=5.0) == pytest.approx(0.0)
    assert height(Wall(), 0.01, speed=-5.0) == 0.0


def test_magnet_has_chai3ds_profile():
    expected = [-3.0, 1.5, 3.0, 1.5, 0.0, 0.0]
    assert -height(Magnet(), -0.01, 0.005, 0.01, 0.055, 0.10, 0.2) == pytest.approx(expected)


def test_magnet_is_continuous():
    z = np.linspace(-0.02, 0.15, 170_001)
    for speed in (0.0, 0.3):
        assert np.abs(np.diff(height(Magnet(), *z, speed=speed))).max() <= 300.0 * 1e-6 * 1.01


def test_texture_repeats_every_4_mm_with_the_slope_of_its_ripples():
    texture = Texture(friction=Friction(static=0.0, dynamic=0.0))
    x = np.arange(0.0, 0.02, 0.0001)
    path = np.stack([x, 0 * x, np.full_like(x, -0.01)], axis=-1)
    force = follow(texture, path, 0.001, np.zeros_like(path))
    load = 3.0
    assert force[:, 2] == pytest.approx(load)
    assert np.abs(force[:, 0]).max() == pytest.approx(load * 2 * np.pi * 0.3 / 4, rel=1e-6)
    spectrum = np.abs(np.fft.rfft(force[:, 0]))
    assert 0.02 / np.argmax(spectrum) == pytest.approx(0.004)
    assert force[40:, 0] == pytest.approx(force[:-40, 0], abs=1e-9)


def test_texture_fades_where_the_loop_cannot_follow():
    texture = Texture(friction=Friction(static=0.0, dynamic=0.0))

    def ripple(speed):
        motion = at(0.0, 0.0, -0.01, velocity=(speed, 0.0, 0.0), step=0.001)
        return -texture.render(motion).force[0] / (3.0 * 2 * np.pi * 0.3 / 4)

    assert [ripple(v) for v in (0.0, 0.3999, 0.6, 0.8, 2.0)] == pytest.approx([1, 1, 0.5, 0, 0], abs=1e-9)


@pytest.mark.parametrize("most", [100.0, 1000.0])
def test_ripples_hold_a_hand_no_more_stiffly_than_they_may(most):
    texture = Texture(friction=Friction(static=0.0, dynamic=0.0), ripples=Ripples(stiffness=most))
    x = np.arange(0.0, 0.004, 1e-6)
    path = np.stack([x, 0 * x, np.full_like(x, -0.01)], axis=-1)
    force = follow(texture, path, 0.001, np.zeros_like(path))[:, 0]
    assert np.abs(np.diff(force) / np.diff(x)).max() == pytest.approx(most, rel=1e-3)


def drawn(friction, step_length, steps, step=0.001):
    x = step_length * np.arange(steps)
    return -follow(friction, np.stack([x, 0 * x, 0 * x], axis=-1), step)[:, 0]


def test_friction_holds_as_a_spring_below_the_static_limit():
    quiet = Friction(damping=0.0)
    force = drawn(quiet, 1e-5, 120)  # 1.2 mm: 0.48 N
    assert force == pytest.approx(400.0 * 1e-5 * np.arange(120))


def test_friction_gives_way_at_the_static_and_slides_at_the_dynamic_limit():
    force = drawn(Friction(load=2.0, damping=0.0), 1e-5, 1000)
    assert force.max() == pytest.approx(2.0 * 0.5, rel=0.01)
    assert force[-1] == pytest.approx(2.0 * 0.35)


@pytest.mark.parametrize("load", [1e-4, 2.0])
def test_the_limit_of_friction_is_in_proportion_to_the_load(load):
    assert drawn(Friction(load=load, damping=0.0), 1e-5, 1000)[-1] == pytest.approx(load * 0.35)


def test_what_is_pressed_straight_in_is_not_rubbed():
    tilted = Plane(point=(0.1, -0.05, 0.2), normal=(1.0, -2.0, 3.0))
    texture = Texture(Wall(tilted), ripples=Ripples(height=0.0))
    path = tilted.point - np.linspace(0.0, 0.01, 50)[:, None] * tilted.n
    pressed = follow(Wall(tilted), path, 0.001)
    np.testing.assert_allclose(follow(texture, path, 0.001), pressed, atol=1e-9)


def test_ripples_belong_to_their_surface():
    """They begin at its point, and lie along it however close to its normal they are drawn."""
    shift = np.array([0.0007, 0.0, 0.3])
    path = np.array([0.0, 0.0, -0.01]) + 1e-4 * np.arange(40)[:, None] * [1.0, 0.0, 0.0]
    moved = Texture(Wall(Plane(point=tuple(shift))))
    np.testing.assert_allclose(follow(moved, path + shift, 0.001), follow(Texture(), path, 0.001), atol=1e-9)
    np.testing.assert_allclose(Ripples(direction=(5e-4, 0.0, 1.0)).across(np.array([0.0, 0.0, 1.0])), [1, 0, 0])
    assert not Ripples(direction=(0.0, 0.0, 1.0)).across(np.array([0.0, 0.0, 1.0])).any()


def test_pulled_by_a_spring_friction_sticks_and_slips():
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


def test_the_energy_of_friction_is_exactly_accounted_for():
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
