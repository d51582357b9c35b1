"""Walls, magnets and textures push and pull as their equations say."""

import numpy as np
import pytest

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import Friction, Magnet, Motion, Plane, Ripples, Texture, Wall
from tests.support.motions import at, follow


def height(effect, *heights, speed=0.0):
    z = np.array(heights, dtype=float)
    zero = np.zeros_like(z)
    motion = Motion(np.stack([zero, zero, z], -1), np.stack([zero, zero, zero + speed], -1))
    return effect.render(motion).force[..., 2]


def test_wall_is_a_spring_that_only_pushes():
    assert height(Wall(), 0.01, 0.0, -0.001, -0.01) == pytest.approx([0.0, 0.0, 0.3, 3.0])


def test_wall_damps_on_the_way_in_and_never_pulls():
    assert height(Wall(), -0.01, speed=-0.5) == pytest.approx(4.0)
    assert height(Wall(), -0.01, speed=0.5) == pytest.approx(2.0)
    assert height(Wall(), -0.01, speed=5.0) == pytest.approx(0.0)
    assert height(Wall(), 0.01, speed=-5.0) == 0.0


def test_wall_stands_where_its_plane_is():
    wall = Wall(Plane(point=(1.0, 0.0, 0.0), normal=(-2.0, 0.0, 0.0)))
    assert wall.render(at(1.02, 5.0, 5.0)).force == pytest.approx([-6.0, 0.0, 0.0])
    assert not wall.render(at(0.98, 5.0, 5.0)).force.any()


def test_wall_meets_a_hand_at_speed_with_a_step_of_that_size():
    assert height(Wall(), -1e-9, speed=-0.5) == pytest.approx(2.0 * 0.5, abs=1e-6)


def test_magnet_has_chai3ds_profile():
    expected = [-3.0, 1.5, 3.0, 1.5, 0.0, 0.0]
    assert -height(Magnet(), -0.01, 0.005, 0.01, 0.055, 0.10, 0.2) == pytest.approx(expected)


def test_magnet_is_continuous():
    z = np.linspace(-0.02, 0.15, 170_001)
    for speed in (0.0, 0.3):
        assert np.abs(np.diff(height(Magnet(), *z, speed=speed))).max() <= 300.0 * 1e-6 * 1.01


def test_magnet_damps_within_reach():
    assert height(Magnet(), 0.0, speed=0.2) == pytest.approx(-0.2)
    assert height(Magnet(), 0.11, speed=0.2) == 0.0


def test_soft_magnet_pulls_less_but_still_has_a_profile():
    soft = Magnet(stiffness=20.0)
    assert -height(soft, 0.05, 0.075, 0.10) == pytest.approx([1.0, 0.5, 0.0])


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


def test_texture_rubs_by_the_walls_push():
    texture = Texture(ripples=Ripples(height=0.0))
    path = np.stack([np.arange(0.0, 0.05, 0.0001), np.zeros(500), np.full(500, -0.01)], axis=-1)
    force = follow(texture, path, 0.001, np.zeros_like(path))
    assert force[-1] == pytest.approx([-0.35 * 3.0, 0.0, 3.0])


def test_no_contact_no_texture():
    assert not Texture().render(at(0.001, 0.0, 0.01, velocity=(0.1, 0.0, 0.0))).force.any()


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Wall(stiffness=-1.0), "Wall: stiffness is -1.0"),
        (lambda: Wall(damping=float("nan")), "Wall: damping is nan"),
        (lambda: Plane(normal=(0.0, 0.0, 0.0)), "Plane: normal"),
        (lambda: Plane(point=(0.0, float("inf"), 0.0)), "Plane: point"),
        (lambda: Magnet(reach=0.0), "Magnet: reach is 0.0"),
        (lambda: Ripples(period=0.0), "Ripples: period"),
        (lambda: Texture(ripples=Ripples(direction=(0.0, 0.0, 1.0))), "along the wall's normal"),
        (lambda: Friction(static=0.2, dynamic=0.3), "Friction: dynamic is 0.3, above static"),
    ],
)
def test_nonsense_is_refused_by_name(make, says):
    with pytest.raises(EffectError, match=says):
        make()
