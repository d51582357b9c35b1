"""The common stages: what is slow stays, what is fast goes, and a force jumps only where it is meant to."""

import numpy as np
import pytest

from tensionlab.haptics.effects import Viscous, Wall
from tensionlab.haptics.effects.effect import smoothstep
from tensionlab.haptics.rendering.renderer import Stages, fade_in, limit_force_slew, low_pass
from tensionlab.haptics.rendering.stability import PassivityController
from tests.helpers.motions import Staged, at, follow


def test_the_low_pass_halves_the_power_at_its_cutoff():
    step = 1e-5
    time = np.arange(20_000) * step
    for frequency, gain in ((6.0, 1 / np.hypot(1, 0.1)), (60.0, 1 / np.sqrt(2)), (600.0, 1 / np.hypot(1, 10))):
        out = [np.zeros(1)]
        for x in np.sin(2 * np.pi * frequency * time):
            out.append(low_pass(np.array([x]), out[-1], 60.0, step))
        assert np.abs(out[10_000:]).max() == pytest.approx(gain, rel=0.01)


def test_the_slew_goes_straight_and_no_faster():
    before, wanted = np.array([1.0, 0.0, 0.0]), np.array([1.0, 3.0, 4.0])
    assert limit_force_slew(wanted, before, 0.5) == pytest.approx([1.0, 0.3, 0.4])
    assert limit_force_slew(wanted, before, 9.0) == pytest.approx(wanted)
    assert limit_force_slew(wanted, before, 0.5, bypass=True) == pytest.approx(wanted)
    assert limit_force_slew(1e-4 * wanted, 1e-4 * before, 5e-5) == pytest.approx([1e-4, 3e-5, 4e-5], rel=1e-9)
    both = limit_force_slew(np.stack([wanted, wanted]), before, 0.5, np.array([True, False]))
    assert both == pytest.approx(np.array([wanted, [1.0, 0.3, 0.4]]))


def test_a_force_comes_at_200_newtons_a_second():
    path = np.tile([0.0, 0.0, -0.01], (100, 1))
    force = follow(Staged(Wall()), path, 0.001)[:, 2]
    assert force[:15] == pytest.approx(0.2 * np.arange(1, 16))
    assert force[15:] == pytest.approx(3.0)


def test_the_effect_has_the_smooth_velocity():
    velocity = np.zeros((100, 3))
    velocity[50:, 0] = 0.1
    force = follow(Staged(Viscous()), np.zeros((100, 3)), 0.001, velocity)[:, 0]
    assert force[50] == pytest.approx(-0.2 * (1 - np.exp(-2 * np.pi * 0.06)))
    assert force[-1] == pytest.approx(-0.2, rel=1e-3)


def test_the_controller_sees_what_is_commanded():
    staged = Staged(Wall(), Stages(PassivityController(5.0)))
    memory = None
    for k in range(40):
        z = 0.01 * np.sin(k / 4)
        motion = at(0.0, 0.0, z, velocity=(0.0, 0.0, 2.5 * np.cos(k / 4)), step=0.001)
        force, memory, _ = staged.render(motion, memory)
        assert memory.stages.observed.forces[-1] == pytest.approx(force)


def shares(ages, before=None, step=0.001):
    """Shares of the force at some ages, one step after the other."""
    for age in ages:
        before = fade_in(age, step, before)
        yield float(smoothstep(before))


def test_stale_input_ends_in_silence_smoothly():
    forces = 3.0 * np.array(list(shares(np.arange(400) / 1000)))
    assert forces[:101] == pytest.approx(3.0)
    assert (forces[251:] == 0.0).all()
    assert np.abs(np.diff(forces)).max() <= 3.0 * 1.5 / 150 * 1.01


def test_fresh_input_brings_the_force_back_no_faster():
    forces = 3.0 * np.array(list(shares(np.zeros(200), fade_in(1.0, 0.001, None))))
    assert np.abs(np.diff(forces)).max() <= 3.0 * 1.5 / 150 * 1.01
    assert forces[0] < 0.01
    assert forces[150] == pytest.approx(3.0)
