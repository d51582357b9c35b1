"""Modules and the host render together what the effects are."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import (
    Bow,
    Magnet,
    Motion,
    Ripples,
    Shape,
    Spring,
    Texture,
    Vibration,
    Viscous,
    Wall,
)
from tensionlab.haptics.rendering.assignment import (
    MAX_APPROACH_M,
    STANDARD_LIMITS,
    CableState,
    EffectFailed,
    ModuleLimits,
    assign,
    module_springs,
)
from tensionlab.model.module import Module
from tests.helpers.motions import at


def pulled(impedance, length):
    """What a module at rest pulls with, as in firmware/PROTOCOL.md."""
    return impedance.feed_forward + impedance.stiffness * max(length - impedance.rest, 0.0)


def along_cable(part, length, direction, limits=STANDARD_LIMITS, gain=1.0):
    """The impedance of a single cable."""
    module = Module("top", [0.0, 0.0, 1.0], 0.5, 6.0, vibration_gain=[[1.0, gain], [100.0, gain]])
    cables = CableState(np.array([length]), direction[None], np.ones(1, dtype=bool), (module,))
    return module_springs(part, at(0.0, 0.0, 0.0), cables, cables.available, limits).impedances[0]


STIFF = [Wall(), Magnet(), Texture(ripples=Ripples(height=0.0)), Shape(), Spring(), Bow()]


@pytest.mark.parametrize("effect", STIFF, ids=lambda e: type(e).__name__)
def test_a_module_renders_the_effect_also_where_the_hand_goes_before_the_host_knows(effect):
    """The module alone follows 2 mm of motion: no link in between. Bow and shape are drawn along their axis."""
    before, after = at(0.0, 0.0, -0.004), at(0.0, 0.0, -0.006)
    part = effect.module_side(before)
    cable = along_cable(part, 1.5, part.axis)
    length = 1.5 - (after.position - before.position) @ part.axis
    assert pulled(cable, length) * part.axis == pytest.approx(effect.render(after).force, abs=1e-6)


def test_a_slanting_cable_pulls_as_hard_along_the_normal():
    slant = np.array([0.6, 0.0, 0.8])
    cable = along_cable(Wall().module_side(at(0.0, 0.0, -0.01)), 2.0, slant)
    assert pulled(cable, 2.0) * 0.8 == pytest.approx(3.0)
    deeper = pulled(cable, 2.0 + 0.8 * 0.002) * 0.8
    assert deeper == pytest.approx(300.0 * 0.012)


@pytest.mark.parametrize("gain", [0.5, 1.0, 1.9])
@pytest.mark.parametrize("lower", [0.5, 0.8])
def test_a_vibrating_cable_never_goes_slack_at_the_motor_or_the_hand(lower, gain):
    part, up = Vibration(amplitude=1.2).module_side(at(0.0, 0.0, 0.0)), np.array([0.0, 0.0, 1.0])
    cable = along_cable(part, 1.0, up, ModuleLimits(lower=lower, slew=700.0), gain)
    assert cable.frequency == 40.0
    assert gain * cable.amplitude == pytest.approx(1.2)  # as the hand feels it
    assert cable.feed_forward - max(1.2, cable.amplitude) == pytest.approx(lower)
    wild = along_cable(Vibration(amplitude=9.0).module_side(at(0.0, 0.0, 0.0)), 1.0, up, gain=gain)
    assert 2.0 * np.pi * 40.0 * wild.amplitude <= STANDARD_LIMITS.slew * (1.0 + 1e-9)


def test_nothing_is_asked_that_a_module_refuses():
    slant = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5)])
    wild = along_cable(Wall(stiffness=1000.0, damping=50.0).module_side(at(0.0, 0.0, -0.01)), 2.0, slant)
    assert (wild.stiffness, wild.damping) == (500.0, 10.0)
    shaking = along_cable(Vibration(amplitude=9.0).module_side(at(0.0, 0.0, 0.0)), 2.0, slant)
    assert shaking.feed_forward + shaking.amplitude <= 6.0
    assert shaking.feed_forward - shaking.amplitude >= 0.5


DIRECTIONS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]])
CABLES = CableState(np.full(4, 2.0), DIRECTIONS, np.ones(4, dtype=bool))


def test_the_best_cable_takes_the_part_and_the_host_the_rest():
    effects = (Texture(), Viscous())
    motion = at(0.0, 0.0, -0.01, velocity=(0.1, 0.0, 0.0))
    plan = assign(effects, motion, CABLES)
    assert list(plan.impedances) == [0]
    assert plan.impedances[0].stiffness == 300.0
    rest = effects[0].host_side(motion).force + effects[1].render(motion).force
    assert plan.force == pytest.approx(rest)
    assert plan.force[2] == 0.0


def test_what_is_desired_is_the_effects_own_force_however_soft_and_aslant_it_is_rendered():
    wall, rough = Wall(stiffness=5000.0), Texture()
    motion = at(0.001, 0.0, -0.01, velocity=(0.1, 0.0, 0.0))
    aslant = CABLES._replace(available=np.array([False, False, True, False]))
    plan = assign((wall,), motion, aslant, host_stiffness=10.0)
    assert plan.desired == pytest.approx(wall.render(motion).force)
    assert plan.expected[0] > 0.5 * plan.expected[2], "it is rendered along the cable"
    across = 0.88 * 0.6 / 0.8 * 500.0 * 0.8**2  # of what the module renders; the host takes 12 % back
    cut = {"stiffness": (5000.0, 500.0 * 0.8**2), "stiffness across": (0.0, across)}
    assert {name: plan.demands[0].softened[name] for name in cut} == {
        name: pytest.approx(each, rel=0.02) for name, each in cut.items()
    }
    for cables in (CABLES, CABLES._replace(available=np.zeros(4, dtype=bool))):
        memory, alone = None, None
        for k in range(20):
            motion = Motion(np.array([1e-3 * k, 0.0, -0.01]), np.array([0.1, 0.0, 0.0]), step=0.01)
            plan = assign((rough,), motion, cables, host_stiffness=30.0, memories=memory)
            memory, own = plan.memories, rough.render(motion, alone)
            alone = own.memory
            assert plan.desired == pytest.approx(own.force)
        assert plan.demands[0].softened["friction.stiffness"] == (rough.friction.stiffness, 30.0)


@pytest.mark.parametrize(
    ("error", "reason"), [(EffectError("as it says"), "as it says"), (KeyError("x"), "KeyError: 'x'")]
)
def test_an_effect_that_fails_is_named_with_its_reason(error, reason):
    class Broken:
        def render(self, motion, memory=None):
            raise error

    with pytest.raises(EffectFailed) as caught:
        assign((Viscous(), Broken()), at(0.0, 0.0, 0.0), CABLES)
    assert (caught.value.effect, caught.value.reason) == (1, reason)


@pytest.mark.parametrize(("frequency", "rendered"), [(60.0, False), (25.0, False), (19.9, True), (5.0, True)])
def test_the_host_leaves_out_a_vibration_that_would_come_out_as_another_frequency(frequency, rendered):
    """60 Hz in 50 steps a second are 10 Hz, and 25 Hz anything between nothing and all."""
    none = CABLES._replace(available=np.zeros(4, dtype=bool))
    hum = Vibration(frequency=frequency, amplitude=0.2)
    forces, cut = [], {}
    for k in range(50):
        motion = Motion(np.zeros(3), np.zeros(3), 0.02 * k + 0.003, 0.02)
        plan = assign((hum,), motion, none)
        forces.append(plan.force[2])
        cut = plan.demands[0].softened
        assert (plan.demands[0].frequency, plan.demands[0].amplitude) == (frequency, 0.2)
        assert not plan.demands[0].force.any()
    assert bool(np.any(forces)) is rendered
    assert cut == ({} if rendered else {"frequency": (frequency, 0.0)})
    assert assign((hum,), motion, CABLES).impedances[0].frequency == frequency
    slow = assign((hum,), motion, none, host_step=0.1)  # modules follow every fifth set-point
    assert bool(slow.demands[0].softened) is (frequency > 4.0)


def test_an_amplitude_that_tensions_are_too_slow_for_is_named():
    """60 N/s are 0.24 N at 40 Hz."""
    plan = assign((Vibration(),), at(0.0, 0.0, 0.0), CABLES)
    assert plan.demands[0].softened == {"amplitude": (1.0, pytest.approx(0.24, abs=0.002))}
    fast = assign((Vibration(),), at(0.0, 0.0, 0.0), CABLES, replace(STANDARD_LIMITS, slew=300.0))
    assert not fast.demands[0].softened
    strong = assign((Vibration(amplitude=9.0, frequency=2.0),), at(0.0, 0.0, 0.0), CABLES)
    assert strong.demands[0].softened == {"amplitude": (9.0, 2.75)}  # half of what is between the limits


@pytest.mark.parametrize(("frequency", "rendered"), [(20.0, 0.48), (40.0, 0.48), (100.0, 0.3 * 300 / 628.3)])
def test_an_amplitude_is_corrected_by_the_gain_of_its_module_and_the_rest_is_named(frequency, rendered):
    rows = [[20.0, 1.2], [40.0, 1.9], [100.0, 0.3]]
    modules = tuple(Module(str(i), -each, 0.5, 6.0, vibration_gain=rows) for i, each in enumerate(DIRECTIONS))
    gain, limits = modules[0].gain_at(frequency), replace(STANDARD_LIMITS, slew=300.0)
    for direction, cosine in ((DIRECTIONS[2], 1.0), (DIRECTIONS[0] + DIRECTIONS[2], np.sqrt(0.9))):
        plan = assign(
            (Vibration(direction, 0.48, frequency),), at(0.0, 0.0, 0.0), CABLES._replace(modules=modules), limits
        )
        ((cable, each),) = plan.impedances.items()
        assert cosine == pytest.approx(max(DIRECTIONS @ direction) / np.linalg.norm(direction))
        assert plan.demands[0].gain == gain
        if frequency < 100.0:
            assert each.amplitude * gain * cosine == pytest.approx(rendered)
            assert not plan.demands[0].softened
        else:
            assert plan.demands[0].softened["amplitude"][1] == pytest.approx(cosine * rendered, rel=1e-3)
        assert cable in (0, 2)


def test_several_cables_are_together_a_vibration_along_an_axis_that_none_has():
    draw = np.random.default_rng(0)
    several = 0
    for _ in range(200):
        directions = draw.normal(size=(5, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        gains = draw.uniform(0.3, 2.0, 5)
        modules = tuple(
            Module(str(i), -each, 0.5, 6.0, vibration_gain=[[30.0, gain]])
            for i, (each, gain) in enumerate(zip(directions, gains, strict=True))
        )
        cables = CableState(np.full(5, 2.0), directions, draw.random(5) > 0.2, modules)
        axis, size = draw.normal(size=3), draw.choice([0.1, 1.0])
        plan = assign((Vibration(tuple(axis), size, 30.0),), at(0.0, 0.0, 0.0), cables)
        if len(plan.impedances) < 2:
            continue
        several += 1
        force = np.zeros(3)
        for cable, each in plan.impedances.items():
            assert cables.available[cable]
            assert each.amplitude <= 60.0 / (2.0 * np.pi * 30.0) * (1.0 + 1e-9)
            assert each.feed_forward >= 0.5 + each.amplitude * max(gains[cable], 1.0) - 1e-9
            force += gains[cable] * each.amplitude * np.cos(2.0 * np.pi * each.phase) * directions[cable]
        assert abs(np.cross(force, axis)).max() < 0.11 * size * np.linalg.norm(axis)
        wanted = plan.demands[0].softened.get("amplitude", (size, size))[1]
        assert force @ axis / np.linalg.norm(axis) == pytest.approx(wanted, rel=0.02)
        assert not plan.expected.any()
    assert several > 100


def test_the_hosts_own_vibration_is_corrected_too():
    modules = tuple(
        Module(str(i), -each, 0.5, 6.0, vibration_gain=[[8.0, 1.25]]) for i, each in enumerate(DIRECTIONS)
    )
    none = CABLES._replace(available=np.zeros(4, dtype=bool), modules=modules)
    motion = Motion(np.zeros(3), np.zeros(3), 1.0 / 32.0, 0.01)  # a quarter of a period
    plan = assign((Vibration(amplitude=0.5, frequency=8.0),), motion, none)
    assert plan.force == pytest.approx([0.0, 0.0, 0.4])
    assert plan.desired == pytest.approx([0.0, 0.0, 0.5])


def test_ripples_that_pass_too_fast_are_named():
    rough = Texture()
    for speed, share in ((0.01, 1.0), (0.03, 0.5), (0.05, 0.0)):
        motion = Motion(np.array([0.0, 0.0, -0.01]), np.array([speed, 0.0, 0.0]), 0.0, 0.02)
        plan = assign((rough,), motion, CABLES)
        assert plan.demands[0].frequency == pytest.approx(speed / 0.004)
        wanted = {} if share == 1.0 else {"ripples.height": (0.0003, pytest.approx(share * 0.0003))}
        assert plan.demands[0].softened == wanted


@pytest.mark.parametrize("available", [True, False])
def test_what_effects_desire_adds_up_whoever_renders_it(available):
    """The wall desires its own stiffness, on a module or on the host."""
    cables = CABLES._replace(available=np.full(4, available))
    motion = Motion(np.array([0.0, 0.0, -0.01]), np.array([0.1, 0.0, -0.1]))
    plan = assign((Wall(), Viscous()), motion, cables, host_stiffness=30.0)
    wall, drag = plan.demands
    assert wall.force == pytest.approx(Wall().render(motion).force)
    assert drag.force == pytest.approx([-0.2, 0.0, 0.2])
    assert (wall.stiffness, wall.damping, drag.stiffness, drag.damping) == (300.0, 2.0, 0.0, 2.0)
    assert wall.force + drag.force == pytest.approx(plan.desired)
    assert wall.share == (1.0 if available else 0.1)


def test_a_wall_that_is_far_away_has_no_cable_yet():
    for height, cables in ((0.9 * MAX_APPROACH_M, 1), (1.1 * MAX_APPROACH_M, 0)):
        assert len(assign((Wall(),), at(0.0, 0.0, height), CABLES).impedances) == cables


def test_two_parts_go_to_two_cables():
    plan = assign((Wall(), Vibration()), at(0.0, 0.0, -0.01), CABLES)
    assert plan.impedances[0].stiffness == 300.0
    assert plan.impedances[2].frequency == 40.0
    assert not plan.force.any()
