"""A weight weighs, a shot kicks, a bow stores what drawing it took."""

import math

import numpy as np
import pytest

from tensionlab.haptics.effects import Bow, Motion, Recoil, Weight, relative
from tests.helpers.motions import at, follow


def test_a_weight_resists_acceleration_as_its_mass_does():
    time = np.arange(0.0, 0.5, 0.001)
    velocity = np.stack([2.0 * time, 0 * time, 0 * time], axis=-1)
    force = follow(Weight(), np.zeros_like(velocity), 0.001, velocity)
    share = 1 - np.exp(-2 * np.pi * 10 * time)
    assert force[:, 0] == pytest.approx(-0.5 * 2.0 * share, abs=1e-9)
    fast = follow(Weight(), np.zeros_like(velocity), 0.001, 10 * velocity)
    assert fast[-1, 0] == pytest.approx(-0.5 * 5.0)


def test_a_weight_comes_in_after_the_grasp():
    time = np.array([0.9, 1.0, 1.05, 1.1, 2.0])
    motion = Motion(np.zeros((5, 3)), np.zeros((5, 3)), time)
    weight = Weight(grasped=1.0).render(motion).force[:, 2]
    assert weight == pytest.approx(-0.5 * 9.81 * np.array([0.0, 0.0, 0.5, 1.0, 1.0]))


def kick(recoil, time):
    motion = Motion(np.zeros((len(time), 3)), np.zeros((len(time), 3)), time)
    return recoil.render(motion)


def test_a_shot_has_its_impulse():
    time = np.linspace(-0.1, 2.0, 210_001)
    force = kick(Recoil(shots=(0.0,)), time).force
    assert np.trapezoid(-force[:, 1], time) == pytest.approx(0.34, abs=0.005)
    assert np.trapezoid(-force[:, 1], time) == pytest.approx(5.5 * (0.0025 + 0.06), rel=1e-5)
    assert -force[:, 1].min() == pytest.approx(5.5)
    assert time[np.argmin(force[:, 1])] == pytest.approx(0.005)


def test_shots_add_up_and_may_leap():
    time = np.array([-0.01, 0.0, 0.105, 0.2, 0.45, 1.0])
    done = kick(Recoil(shots=(0.0, 0.1)), time)
    assert -done.force[2, 1] == pytest.approx(5.5 + 5.5 * math.exp(-0.1 / 0.06))
    assert done.bypass_slew.tolist() == [False, True, True, True, False, False]


def bow_pull(bow, draw, time=0.0):
    position = np.zeros((len(draw), 3))
    position[:, 1] = -(bow.brace + np.asarray(draw))
    return bow.render(Motion(position, np.zeros_like(position), time)).force[:, 1]


def test_a_bow_is_a_spring_up_to_6_newtons():
    assert bow_pull(Bow(), [-0.1, 0.0, 0.3, 0.6, 0.7]) == pytest.approx([1.0, 1.0, 3.49, 5.98, 6.0])


def test_a_compound_bow_lets_off():
    bow = Bow(let_off=0.7)
    assert bow_pull(bow, [0.45, 0.6]) == pytest.approx([1.0 + 8.3 * 0.45, 0.3 * 5.98])
    draw = np.linspace(0.0, 0.6, 60_001)
    assert np.abs(np.diff(bow_pull(bow, draw))).max() < 1e-3
    assert bow_pull(bow, draw).max() < bow_pull(Bow(), draw).max()


def test_a_loosed_string_falls_slack_within_10_ms():
    silent = Bow(loosed=1.0, hum=0.0)
    time = np.array([0.99, 1.005, 1.01, 1.1])
    draw = np.full(4, 0.6)
    assert bow_pull(silent, draw, time) == pytest.approx([5.98, (5.98 + 0.5) / 2, 0.5, 0.5])


def test_a_loosed_string_hums_but_never_goes_slack():
    time = np.linspace(1.0, 1.5, 50_001)
    pull = bow_pull(Bow(loosed=1.0), np.full(len(time), 0.3), time)
    assert pull.min() >= 0.5 - 1e-12
    late = time > 1.01
    hum = pull[late] - 0.5 - np.exp(-(time[late] - 1.0) / 0.05)
    assert hum == pytest.approx(np.exp(-(time[late] - 1.0) / 0.05) * np.sin(2 * np.pi * 60 * (time[late] - 1.0)))
    assert pull[-1] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("late", [0.0, 0.0005, 0.05, 0.24])
def test_from_its_release_on_a_string_hums_on_a_module_too_and_may_leap(late):
    fading = math.exp(-late / 0.05)
    for bow in (Bow(loosed=1.0), Bow(loosed=1.0, let_off=0.7)):
        part = bow.module_side(at(0.0, -0.5, 0.0, time=1.0 + late))
        assert (part.feed_forward, part.amplitude, part.stiffness) == pytest.approx((0.5 + fading, fading, 0.0))
    pull = bow_pull(Bow(loosed=1.0), [0.3], np.array([1.0 + late]))
    falling = 0.5 + 2.99 * max(1 - late / 0.01, 0.0)
    assert pull == pytest.approx(max(falling, 0.5 + fading) + fading * math.sin(2 * math.pi * 60 * late))
    times = np.array([-1e-9, late, 0.26]) + 1.0
    assert Bow(loosed=1.0).render(at(0.0, -0.5, 0.0, time=times)).bypass_slew.tolist() == [False, True, False]


def test_a_bow_is_between_two_hands():
    draw = at(0.0, 0.0, 1.0, velocity=(0.0, 1.0, 0.0))
    bow = at(0.0, 0.6, 1.0, velocity=(0.0, -1.0, 0.0))
    seen = relative(draw, bow)
    assert seen.position == pytest.approx([0.0, -0.6, 0.0])
    assert seen.velocity == pytest.approx([0.0, 2.0, 0.0])
    assert Bow().render(seen).force == pytest.approx([0.0, 1.0 + 8.3 * 0.4, 0.0])
    assert not Bow().render(at(0.0, 0.0, 0.0)).force.any()
