"""What a hand feels of effects, on real firmware in lockstep: what modules render, and what the host may."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.demand import Demand, Pose, RigState
from tensionlab.haptics.effects import (
    Friction,
    Motion,
    Plane,
    Rendered,
    Shape,
    Sphere,
    Spring,
    Vibration,
    Viscous,
    Wall,
)
from tensionlab.haptics.rendering.assignment import ModuleLimits
from tensionlab.haptics.rendering.renderer import INITIAL_DELAY_S, Renderer
from tensionlab.hardware.runner.pretension import WINDOW_S
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import WorldClock
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.simulated_module import COLUMNS
from tensionlab.hardware.simulation.world import World

RIG = tl.load_rig("datasets/rigs/bartels2026-validation.toml")
HOME, TOP = RIG.home, 3
PERIOD = 1.0 / 50.0


class Hand:
    """0.3 kg that are pushed, and give way to the cables. A motion of the world.

    push(position) tells how, in N.
    """

    def __init__(self, start, push, mass=0.3, damping=2.0):
        self.position, self.velocity, self.pull = np.array(start), np.zeros(3), np.zeros(3)
        self.cables = RIG.cables(self.position)
        self.push, self.mass, self.damping, self.time, self.path = push, mass, damping, 0.0, []

    @property
    def lengths(self):
        return self.cables.lengths

    def apply_tensions(self, tensions):
        self.pull = tensions @ self.cables.directions

    def __call__(self, time):
        step, self.time = time - self.time, time
        force = self.pull + self.push(self.position) - self.damping * self.velocity
        self.velocity = self.velocity + step * force / self.mass
        self.position = self.position + step * self.velocity
        self.path.append(self.position)
        self.cables = RIG.cables(self.position)
        return Pose(self.position)


class Seen(NamedTuple):
    """A cycle: what was known, what was desired, how late, how stiff, and how the cables really pulled."""

    state: RigState
    demand: Demand
    delay: float
    ceiling: float
    wrench: np.ndarray


def rendered(effects, motion, seconds=1.0, latency=0.0, share=1.0, world=None, limits=None):
    """Render effects, the same ones or a function of the time, on a hand; every cycle."""
    world = World(RIG, motion) if world is None else world
    renderer, cycles = Renderer(RIG), []
    renderer.limits = limits or renderer.limits

    def demand(state):
        now = Motion(state.pose.position, state.twist, state.time, PERIOD)
        desired = renderer(effects(state.time) if callable(effects) else effects, now, state, share)
        cycles.append(Seen(state, desired, renderer.delay, renderer.ceiling, world.wrench))
        return desired

    group = world.group(Conditions(latency))
    Runner(RIG, group, "newton", demand, clock=WorldClock(world)).run(seconds)
    return cycles


def held(*offset):
    """A hand that stays where it is."""
    return lambda time: Pose(HOME + np.array(offset, dtype=float))


def wall(normal, stiffness, damping=2.0):
    return {"wall": Wall(Plane(tuple(HOME), tuple(normal)), stiffness, damping)}


def off(normal, degrees):
    """A direction so far off another."""
    angle = math.radians(degrees)
    return math.cos(angle) * np.array(normal) + math.sin(angle) * np.array([1.0, 0.0, 0.0])


def shaking(hand, normal, seconds=1.0):
    """How far does a hand go to and fro along a normal at the end, in m?"""
    return float(np.ptp(np.array(hand.path[-round(seconds / 1e-3) :]) @ normal))


UP, DOWN = np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])


@pytest.mark.parametrize("latency", [0.0, 0.005, 0.02])
def test_a_stiff_wall_is_its_modules_and_is_rendered_at_once(latency):
    """200 N/m against a hand that goes in and out twice a second: as good with late links as without."""
    depths, pushes = [], []

    def depth(time):
        return 0.012 + 0.008 * math.sin(4.0 * math.pi * time)

    world = World(RIG, lambda time: Pose(HOME - depth(time) * UP))

    def note(_):
        depths.append(depth(world.time))
        pushes.append(world.wrench @ UP)

    world.watch = note
    cycles = rendered(wall(UP, 200.0, 0.0), None, 2.0, latency, world=world)
    assert list(cycles[-1].demand.impedances) == ["top"]
    after = len(depths) // 2
    error = np.array(pushes[after:]) - 200.0 * np.array(depths[after:])
    # Spools rub with 0.05 N each. A host that is 20 ms late would be off by 0.3 N, at 80 ms by 1.2 N.
    assert np.sqrt(np.mean(error**2)) < 0.16


def test_a_module_with_a_wall_renders_other_forces_too():
    """The wall has the only cable that can pull up; so does the spring need it."""
    effects = wall(UP, 200.0) | {"spring": Spring(tuple(HOME + 0.11 * UP), 20.0)}
    cycle = rendered(effects, held(0.0, 0.01, 0.0))[-1]
    assert list(cycle.demand.impedances) == ["top"]
    np.testing.assert_allclose(cycle.wrench, [0.0, 2.0, 0.0], atol=0.15)


@pytest.mark.parametrize("degrees", [20.0, 40.0])
@pytest.mark.parametrize("latency", [0.0, 0.02])
def test_a_wall_off_its_cable_is_calm_and_within_45_degrees(degrees, latency):
    """What the cable pulls across, the host takes back as stiffly as its link allows; late springs are softer."""
    normal, rendered_stiffness = off(UP, degrees), 124.0 if degrees == 40.0 and latency > 0.0 else 175.0

    def push(position):  # 1 N into the wall; the arm holds it sideways
        return -1.0 * normal - 30.0 * (position - HOME - (position - HOME) @ normal * normal)

    hand = Hand(HOME, push)
    cycles = rendered(wall(normal, 200.0), hand, 4.0, latency)
    assert "top" in cycles[-1].demand.impedances
    assert shaking(hand, normal) < 1e-3
    assert hand.position @ normal == pytest.approx(HOME @ normal - 1.0 / rendered_stiffness, abs=1.5e-3)
    wrench = cycles[-1].wrench
    assert wrench @ normal > math.cos(math.radians(45.0)) * np.linalg.norm(wrench)


@pytest.mark.parametrize("latency", [0.0, 0.02])
def test_where_no_module_has_a_spring_the_host_renders_a_wall_no_stiffer_than_it_may(latency):
    hand = Hand(HOME - 0.02 * DOWN, lambda position: -1.0 * DOWN)
    cycles = rendered(wall(DOWN, 300.0), hand, 5.0, latency, limits=ModuleLimits(stiffness=0.0))
    assert shaking(hand, DOWN) < 1e-3
    for cycle in cycles[1:]:
        assert not cycle.demand.impedances
        # 0.5 of (2 N s/m) / (10 ms + delay)
        assert cycle.ceiling == pytest.approx(1.0 / (PERIOD / 2 + cycle.delay))
    last = cycles[-1]
    depth = -(last.state.pose.position - HOME) @ DOWN
    assert last.demand.wrench @ DOWN == pytest.approx(last.ceiling * depth, rel=0.05)
    assert last.wrench @ DOWN == pytest.approx(1.0, abs=0.1)


def test_without_the_ceiling_that_wall_would_shake():
    """What the test above keeps away from: a host that renders 300 N/m as they are."""
    hand = Hand(HOME - 0.02 * DOWN, lambda position: -1.0 * DOWN)
    world, effect = World(RIG, hand), wall(DOWN, 300.0)["wall"]

    def demand(state):
        return Demand(effect.render(Motion(state.pose.position, state.twist, state.time, PERIOD)).force)

    Runner(RIG, world.group(Conditions(0.02)), "newton", demand, clock=WorldClock(world)).run(1.4)
    assert shaking(hand, DOWN) > 0.02


@pytest.mark.parametrize(("amplitude", "frequency", "share"), [(0.5, 10, 1.0), (0.8, 10, 0.5), (0.2, 40, 1.0)])
def test_a_vibration_is_its_modules_and_keeps_its_cable_taut(amplitude, frequency, share):
    """Below what the modules' slew allows, which is 60 N/s as they come: ``2 pi f A``."""
    world, commanded, tensions = World(RIG), [], []

    def note(traces):
        commanded.append(traces[TOP][:, COLUMNS["commanded"]])
        tensions.append(traces[TOP][:, COLUMNS["tension"]])

    world.watch = note
    effects = {"buzz": Vibration((0.0, 1.0, 0.0), amplitude, frequency)}
    cycles = rendered(effects, None, 2.0, share=share, world=world)
    assert list(cycles[-1].demand.impedances) == ["top"]
    assert abs(cycles[-1].demand.wrench @ UP) < 1e-9  # on average it pulls nowhere
    motor, cable = (np.concatenate(each)[-4100:-100] for each in (commanded, tensions))  # a second, at 4 kHz
    spectrum = 2.0 * np.abs(np.fft.rfft(motor)) / len(motor)
    assert np.argmax(spectrum[1:]) + 1 == frequency
    assert spectrum[frequency] == pytest.approx(share * amplitude, rel=0.01)
    assert motor.min() >= RIG.limits.lower[TOP] - 1e-3
    if frequency == 10:  # at 40 Hz the spool swings on its cable, which is 5 kN/m
        assert np.ptp(cable) / 2 == pytest.approx(share * amplitude, rel=0.1)
        assert cable.min() >= RIG.limits.lower[TOP]


@dataclass(frozen=True)
class Push:
    """An effect that is not passive."""

    def render(self, motion, memory=None):
        return Rendered(2.0 * UP)


def test_only_passive_effects_are_kept_from_adding_energy():
    def rising(time):
        return Pose(HOME + 0.1 * max(time - WINDOW_S, 0.0) * UP)

    np.testing.assert_allclose(rendered({"push": Push()}, rising)[-1].demand.wrench, 2.0 * UP, atol=1e-6)


def test_the_share_is_that_of_everything_and_without_one_the_cables_are_taut():
    for share, force in ((1.0, 2.0), (0.5, 1.0)):
        last = rendered(wall(UP, 100.0), held(0.0, -0.02, 0.0), share=share)[-1]
        assert last.demand.impedances["top"].stiffness == pytest.approx(100.0 * share)
        np.testing.assert_allclose(last.wrench, force * UP, atol=0.15)
    last = rendered(wall(UP, 100.0) | {"buzz": Vibration()}, held(0.0, -0.02, 0.0), share=0.0)[-1]
    assert last.demand.wrench is None
    assert not last.demand.impedances
    np.testing.assert_allclose(last.state.tensions, RIG.limits.lower, atol=1e-6)


def test_what_goes_on_remembers_and_what_is_new_does_not():
    """A bristle holds a hand that went aside while it was there: for as long as it is there."""
    rub, other = Friction(load=4.0), Viscous(1.0)

    def effects(time):
        if time < 0.5:
            return {"rub": rub}
        if time < 1.0:
            return {"other": other, "rub": rub}  # another one comes
        if time < 1.5:
            return {"rub": Friction(load=3.0)}  # another parameter, and the other goes
        if time < 2.0:
            return {"rub": Shape(Sphere(tuple(HOME + UP), 0.1))}  # another kind by the same name, with a proxy
        return {"rub": rub}

    def motion(time):
        return Pose(HOME + np.array([0.01 * min(max(4.0 * (time - WINDOW_S) - 1.0, 0.0), 1.0), 0.0, 0.0]))

    found = {round(seen.state.time, 2): seen.demand.wrench[0] for seen in rendered(effects, motion, 2.5)}
    for time in (0.6, 0.9, 1.4):
        assert found[time] == pytest.approx(found[0.48], abs=0.1)
    assert found[0.48] < -0.2
    for time in (1.9, 2.4):
        assert abs(found[time]) < 0.05


@pytest.mark.parametrize("latency", [0.0, 0.01, 0.02, 0.05])
def test_the_delay_it_finds_is_how_late_what_it_demands_is_measured(latency):
    """Timed by a force that jumps, which the tensions reported show in a later cycle."""
    jump = 1.0
    cycles = rendered(
        lambda time: {"pull": Spring(tuple(HOME + UP), 2.0)} if time > jump else {},
        held(0.0, 0.0, 0.0),
        2.5,
        latency,
    )
    assert cycles[0].delay == INITIAL_DELAY_S or cycles[0].delay >= 2 * latency  # reeling in may have shown it
    first = next(seen.state.time for seen in cycles if seen.demand.wrench @ UP > 0.5)
    before = cycles[round(jump / PERIOD) - 1].state.tensions
    after = [seen for seen in cycles if seen.state.time >= jump]
    heard = next(seen.state.time for seen in after if np.ptp(seen.state.tensions - before) > 0.05)
    assert heard - first >= 2 * latency
    assert -1e-6 < cycles[-1].delay - (heard - first) < 2.1 * PERIOD  # the worst of 100 counts


def test_the_controller_is_kept_while_the_delay_is_much_the_same():
    """A cycle more or less late is no news: what the observer knows of the energy must not be lost for it."""
    renderer, kept = Renderer(RIG), []
    state = rendered({}, held(0.0, 0.0, 0.0), 1.0)[-1].state
    for number in range(20):
        late = replace(state, delays=np.full(RIG.m, 3.0 * PERIOD + 1e-5 * number))
        renderer({}, Motion(HOME, np.zeros(3), state.time, PERIOD * (1.02 if number % 2 else 0.98)), late)
        kept.append(renderer._controller)
    assert all(one is other for one, other in pairwise(kept))
    renderer({}, Motion(HOME, np.zeros(3), state.time, PERIOD), replace(state, delays=np.full(RIG.m, 6 * PERIOD)))
    assert renderer._controller.delay == 6


def test_a_late_cycle_makes_the_host_softer_and_no_single_one_makes_it_stiffer():
    """The force is held for the longest of the last 100 cycles, whether or not the delay changes with it."""
    renderer = Renderer(RIG)
    state = replace(rendered({}, held(0.0, 0.0, 0.0), 0.2)[-1].state, delays=np.full(RIG.m, 0.1))

    def ceiling(step):
        renderer({}, Motion(HOME, np.zeros(3), state.time, step), state)
        return renderer.ceiling

    soft, usual = 1.0 / (0.08 / 2 + 0.1), 1.0 / (PERIOD / 2 + 0.1)
    assert ceiling(PERIOD) == pytest.approx(usual)
    assert ceiling(0.001) == pytest.approx(usual)
    assert ceiling(0.08) == pytest.approx(soft)
    assert [ceiling(PERIOD) for _ in range(99)] == pytest.approx([soft] * 99)
    assert ceiling(PERIOD) == pytest.approx(usual)
