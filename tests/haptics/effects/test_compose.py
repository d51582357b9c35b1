"""Sums add, ramps rise, stale input ends in silence; the parts for modules are the same forces."""

import numpy as np
import pytest

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import (
    Bow,
    Friction,
    Magnet,
    ModuleLimits,
    Motion,
    OnModule,
    Ramp,
    Recoil,
    Ripples,
    Shape,
    Spring,
    Sum,
    Texture,
    Vibration,
    Viscous,
    Wall,
    Water,
    WhileFresh,
)
from tensionlab.haptics.effects.on_module import along_cable, divide
from tests.support.motions import at, follow


def test_a_sum_adds_up_and_remembers_for_all():
    path = np.cumsum(np.random.default_rng(3).normal(size=(200, 3)) * 1e-3, axis=0)
    parts = (Friction(), Shape(), Water(), Wall())
    together = follow(Sum(parts), path, 0.001)
    assert together == pytest.approx(sum(follow(part, path, 0.001) for part in parts))
    assert not Sum(()).render(at(0.0, 0.0, 0.0)).force.any()


def test_a_sum_may_leap_where_a_part_does():
    assert Sum((Wall(), Recoil(shots=(0.0,)))).render(at(0.0, 0.0, 0.0)).sudden
    assert not Sum((Wall(), Recoil())).render(at(0.0, 0.0, 0.0)).sudden


def test_a_ramp_rises_over_2_seconds():
    force = [Ramp(Wall(), begin=1.0).render(at(0, 0, -0.01, time=t)).force[2] for t in (0.0, 1.0, 2.0, 3.0, 9.0)]
    assert force == pytest.approx([0.0, 0.0, 1.5, 3.0, 3.0])


def test_stale_input_ends_in_silence_smoothly():
    fresh = WhileFresh(Wall())
    memory, forces = None, []
    for k in range(400):
        motion = at(0.0, 0.0, -0.01, time=k / 1000, step=0.001, age=k / 1000)
        force, memory, _ = fresh.render(motion, memory)
        forces.append(force[2])
    forces = np.array(forces)
    assert forces[:101] == pytest.approx(3.0)
    assert (forces[251:] == 0.0).all()
    assert np.abs(np.diff(forces)).max() <= 3.0 * 1.5 / 150 * 1.01


def test_fresh_input_brings_the_force_back_no_faster():
    fresh = WhileFresh(Wall())
    _, memory, _ = fresh.render(at(0.0, 0.0, -0.01, age=1.0))
    forces = []
    for _ in range(200):
        force, memory, _ = fresh.render(at(0.0, 0.0, -0.01, age=0.0, step=0.001), memory)
        forces.append(force[2])
    assert np.abs(np.diff(forces)).max() <= 3.0 * 1.5 / 150 * 1.01
    assert forces[0] < 0.01
    assert forces[150] == pytest.approx(3.0)


def test_nonsense_is_refused_by_name():
    with pytest.raises(EffectError, match="Ramp: duration"):
        Ramp(Wall(), duration=0.0)
    with pytest.raises(EffectError, match="WhileFresh: fade"):
        WhileFresh(Wall(), fade=-1.0)


def pulled(impedance, length):
    """What a module at rest pulls with, as in firmware/PROTOCOL.md."""
    return impedance.feed_forward + impedance.stiffness * max(length - impedance.rest, 0.0)


STIFF = [Wall(), Magnet(), Texture(ripples=Ripples(height=0.0)), Shape(), Spring(), Bow()]


@pytest.mark.parametrize("effect", STIFF, ids=lambda e: type(e).__name__)
@pytest.mark.parametrize("height", [-0.02, -0.001, 0.005, 0.05, 0.3])
def test_a_module_and_the_host_render_together_what_the_effect_is(effect, height):
    """With a cable right along the axis, for a hand at rest."""
    motion = at(0.0, 0.0, height)
    wanted = effect.render(motion).force
    assert isinstance(effect, OnModule)
    part = effect.on_module(motion)
    left = effect.on_host(motion).force
    assert left == pytest.approx(0.0)
    if part is None:
        assert wanted == pytest.approx(0.0)
        return
    cable = along_cable(part, 1.5, part.axis)
    assert pulled(cable, 1.5) * part.axis == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("effect", STIFF, ids=lambda e: type(e).__name__)
def test_and_also_where_the_hand_goes_before_the_host_knows(effect):
    """The module alone follows 2 mm of motion: no link in between. Bow and shape are drawn along their axis."""
    before, after = at(0.0, 0.0, -0.004), at(0.0, 0.0, -0.006)
    part = effect.on_module(before)
    cable = along_cable(part, 1.5, part.axis)
    length = 1.5 - (after.position - before.position) @ part.axis
    assert pulled(cable, length) * part.axis == pytest.approx(effect.render(after).force, abs=1e-6)


def test_a_slanting_cable_pulls_as_hard_along_the_normal():
    slant = np.array([0.6, 0.0, 0.8])
    cable = along_cable(Wall().on_module(at(0.0, 0.0, -0.01)), 2.0, slant)
    assert pulled(cable, 2.0) * 0.8 == pytest.approx(3.0)
    deeper = pulled(cable, 2.0 + 0.8 * 0.002) * 0.8
    assert deeper == pytest.approx(300.0 * 0.012)


def test_a_vibrating_cable_never_goes_slack():
    for lower in (0.5, 0.8):
        limits = ModuleLimits(lower=lower)
        cable = along_cable(Vibration().on_module(at(0.0, 0.0, 0.0)), 1.0, np.array([0.0, 0.0, 1.0]), limits)
        assert cable.feed_forward - cable.amplitude == pytest.approx(lower)
        assert (cable.amplitude, cable.frequency) == (1.0, 40.0)


def test_nothing_is_asked_that_a_module_refuses():
    slant = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5)])
    wild = along_cable(Wall(stiffness=1000.0, damping=50.0).on_module(at(0.0, 0.0, -0.01)), 2.0, slant)
    assert (wild.stiffness, wild.damping) == (500.0, 10.0)
    shaking = along_cable(Vibration(amplitude=9.0).on_module(at(0.0, 0.0, 0.0)), 2.0, slant)
    assert shaking.feed_forward + shaking.amplitude <= 6.0
    assert shaking.feed_forward - shaking.amplitude >= 0.5


def test_before_contact_the_module_does_not_damp():
    up = np.array([0.0, 0.0, 1.0])
    away = along_cable(Wall().on_module(at(0.0, 0.0, 0.01)), 1.0, up)
    assert (away.damping, away.rest) == (0.0, pytest.approx(1.01))
    assert along_cable(Wall().on_module(at(0.0, 0.0, -0.01)), 1.0, up).damping == 2.0


CABLES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]])


def test_the_best_cable_takes_the_part_and_the_host_the_rest():
    effects = (Texture(), Viscous())
    motion = at(0.0, 0.0, -0.01, velocity=(0.1, 0.0, 0.0))
    divided = divide(effects, motion, None, np.full(4, 2.0), CABLES)
    assert list(divided.impedances) == [0]
    assert divided.impedances[0].stiffness == 300.0
    rest = effects[0].on_host(motion).force + effects[1].render(motion).force
    assert divided.force == pytest.approx(rest)
    assert divided.force[2] == 0.0


def test_two_parts_go_to_two_cables():
    divided = divide((Wall(), Vibration()), at(0.0, 0.0, -0.01), None, np.full(4, 2.0), CABLES)
    assert divided.impedances[0].stiffness == 300.0
    assert divided.impedances[2].frequency == 40.0
    assert not divided.force.any()


def test_what_no_cable_can_do_the_host_does():
    down = divide((Wall(),), at(0.0, 0.0, -0.01), None, np.full(4, 2.0), -CABLES)
    assert down.impedances == {}
    assert down.force == pytest.approx([0.0, 0.0, 3.0])
    able = np.zeros(4, dtype=bool)
    assert divide((Wall(),), at(0.0, 0.0, -0.01), None, np.full(4, 2.0), CABLES, able).force[2] == 3.0


def test_a_ramp_scales_the_modules_part_too():
    ramp = Ramp(Wall())
    divided = divide((ramp,), at(0.0, 0.0, -0.01, time=1.0), None, np.full(4, 2.0), CABLES)
    assert divided.impedances[0].stiffness == 150.0
    assert not divided.force.any()
    fresh = divide((WhileFresh(Wall()),), at(0.0, 0.0, -0.01, age=0.175), None, np.full(4, 2.0), CABLES)
    assert fresh.impedances[0].stiffness == pytest.approx(150.0)


def test_memory_goes_round():
    effects, memory = (Viscous(damping=0.0), Texture()), None
    for k in range(50):
        motion = Motion(np.array([1e-4 * k, 0.0, -0.01]), np.array([0.1, 0.0, 0.0]))
        divided = divide(effects, motion, memory, np.full(4, 2.0), CABLES)
        memory = divided.memory
    assert divided.force[0] < -0.5
