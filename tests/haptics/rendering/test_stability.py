"""Walls under the cap stand still, the bound is where a simulation finds it, the observer stops what shakes."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.errors import EffectError
from tensionlab.haptics.effects import Friction, Magnet, Motion, Shape, Texture, Viscous, Wall
from tensionlab.haptics.effects.shape import VirtualCoupling
from tensionlab.haptics.rendering.renderer import Stages
from tensionlab.haptics.rendering.stability import (
    PassivityController,
    cap_stiffness,
    max_damping,
    stiffness_cap,
)
from tensionlab.model.wall_stiffness import stiffness_bound
from tests.helpers.motions import Staged
from tests.helpers.simulated_wall import Hand, measured_bound, simulate

STEP = 0.001
DELAYS = np.array([0, 1, 2, 5, 10, 15, 20, 25, 30]) * 1e-3


def law(wall):
    """A wall effect as the law of the simulated hand."""

    def push(k, position, velocity):
        zero = np.zeros_like(position)
        motion = Motion(
            np.stack([zero, zero, position], axis=-1), np.stack([zero, zero, velocity], axis=-1), k * STEP, STEP
        )
        return wall.render(motion).force[..., 2]

    return push


# Bounds in N/m by the delay in s that the project agreed on.
AGREED = {0.0: 4000.0, 0.005: 366.0, 0.020: 100.0, 0.030: 68.0}


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_the_predicted_bound_is_within_10_percent_of_the_simulated_one(damping):
    predicted = stiffness_bound(DELAYS, STEP, 2.0, damping)
    measured = measured_bound(DELAYS, damping, seconds=6.0)
    assert measured == pytest.approx(predicted, rel=0.10)
    assert measured == pytest.approx(predicted, rel=0.05), "and closer than that"
    if damping == 0.0:
        there = np.isin(DELAYS, list(AGREED))
        assert measured[there] == pytest.approx(list(AGREED.values()), rel=0.015)
        assert predicted[there] == pytest.approx(list(AGREED.values()), rel=0.04)


@pytest.mark.parametrize("delay", [0, 5, 20, 30])
@pytest.mark.parametrize(("damping", "seconds"), [(0.0, 6.0), (2.0, 4.0)])
def test_a_wall_under_the_cap_comes_to_rest(delay, damping, seconds):
    cap = stiffness_cap(delay * 1e-3, STEP, 2.0, damping)
    wall, _ = cap_stiffness(Wall(stiffness=1e6, damping=damping), cap)
    assert wall.stiffness == cap
    push, speeds = np.array([2.0, 5.0, 0.5]), np.array([0.0, -1.0, -0.3])
    track = simulate(law(wall), np.array(delay), 0.01, speeds, Hand(push=push), STEP, seconds)
    assert np.ptp(track.position[-1000:], axis=0).max() < 1e-4
    assert track.position[-1] == pytest.approx(-push / wall.stiffness, abs=1e-4)


def test_a_wall_over_the_bound_shakes():
    wall = Wall(stiffness=1.2 * float(stiffness_bound(0.020, STEP, 2.0)), damping=0.0)
    track = simulate(law(wall), np.array([20]), -2.0 / wall.stiffness, -0.01, Hand(), STEP, 6.0)
    assert np.abs(track.velocity[-1000:]).max() > 0.1


def test_the_cap_is_half_of_what_the_slowest_trips_allow():
    trips = np.full(1000, 0.020)
    assert stiffness_cap(trips, STEP, 2.0) == pytest.approx(0.5 * 2.0 / 0.0205)
    trips[:20] = 0.060
    assert stiffness_cap(trips, STEP, 2.0) == pytest.approx(0.5 * 2.0 / 0.0605)
    assert stiffness_cap(0.020, STEP, 1.3, 2.0, 0.5) == pytest.approx(80.0, rel=0.01)  # needs b + B of 3.3


def test_every_stiffness_of_an_effect_is_capped():
    whole = (Wall(), Texture(), Magnet(), Shape(), Viscous(), Friction(stiffness=10.0))
    soft, cut = zip(*[cap_stiffness(effect, 50.0) for effect in whole], strict=True)
    assert [soft[0].stiffness, soft[1].wall.stiffness, soft[1].friction.stiffness] == [50.0, 50.0, 50.0]
    assert [soft[1].ripples.stiffness, soft[2].stiffness, soft[3].coupling.stiffness] == [50.0, 50.0, 50.0]
    assert soft[4:] == whole[4:]
    inner = {"wall.stiffness", "friction.stiffness", "ripples.stiffness"}
    assert [*map(set, cut)] == [{"stiffness"}, inner, {"stiffness"}, {"coupling.stiffness"}, set(), set()]
    assert cap_stiffness(Wall(stiffness=51.0), 50.0) == (Wall(stiffness=50.0), {"stiffness": 51.0})
    assert cap_stiffness(Shape(coupling=VirtualCoupling(400.0, 1.0)), 50.0)[0].coupling == VirtualCoupling(
        50.0, 1.0
    )
    # A module renders the wall with its own stiffness; the host renders friction and ripples.
    rough, cut = cap_stiffness(Texture(), 50.0, "host")
    assert [rough.wall.stiffness, rough.friction.stiffness, rough.ripples.stiffness] == [300.0, 50.0, 50.0]
    assert cut == {"friction.stiffness": 400.0, "ripples.stiffness": 10_000.0}


def test_nonsense_is_refused_by_name():
    for make, says in (
        (lambda: stiffness_bound(0.01, 0.0, 2.0), "step is 0.0"),
        (lambda: stiffness_bound(-0.01, STEP, 2.0), "delay is -0.01"),
        (lambda: stiffness_cap([0.01, float("nan")], STEP, 2.0), "round trips"),
        (lambda: PassivityController(float("inf")), "max_damping is inf"),
    ):
        with pytest.raises(EffectError, match=says):
            make()


# Of the hands that meet a wall: some bounce off, some are pressed against it.
PUSHES, SPEEDS = np.array([0.1, 0.5, 2.0, 5.0]), np.array([-0.5, -0.3, 0.0, -0.5])


def bounce(delay, observed, factor=3.0, pushes=PUSHES, speeds=SPEEDS, seconds=4.0, **stages):
    """Hands of 0.3 kg against a wall of ``factor`` times the bound, with or without the observer.

    Without more, the observer sees the velocity as it is, and the force is not slewed.
    """
    wall = Wall(stiffness=factor * float(stiffness_bound(delay * 1e-3, STEP, 2.0)), damping=0.0)
    controller = PassivityController(max_damping(0.3, delay * 1e-3, STEP), delay) if observed else None
    staged = Staged(wall, Stages(controller, **(stages or {"cutoff": 1e9, "slew": 1e9})))
    memory = None

    def host(k, position, velocity):
        nonlocal memory
        zero = np.zeros_like(position)
        motion = Motion(np.stack([zero, zero, position], axis=-1), np.stack([zero, zero, velocity], axis=-1))
        force, memory, _ = staged.render(motion, memory)
        return force[..., 2]

    hand = Hand(push=pushes)
    track = simulate(host, np.array(delay), 0.02, speeds, hand, STEP, seconds)
    return track, np.cumsum(hand.damping * track.velocity[:-1] ** 2 * STEP, axis=0)


AS_RENDERED = {"cutoff": 60.0, "slew": 200.0}


@pytest.mark.parametrize(
    ("delay", "stages"),
    [*((delay, {"seconds": 3.0}) for delay in (0, 1, 5, 10, 20, 30)), (0, AS_RENDERED), (30, AS_RENDERED)],
)
def test_with_the_observer_the_system_is_passive_at_three_times_the_bound(delay, stages):
    """Wall, loop and the hand's own damping together never give out more than they took, at any step."""
    track, lost = bounce(delay, observed=True, **stages)
    assert (track.energy() + lost).min() >= -1e-9
    assert np.abs(track.velocity[-1000:]).max() < 0.07
    assert np.ptp(track.position[-1000:], axis=0).max() < 0.005


@pytest.mark.parametrize("delay", [1, 5, 10, 20, 30])
def test_and_without_it_is_not(delay):
    track, lost = bounce(delay, observed=False, seconds=2.0)
    assert ((track.energy() + lost).min(axis=0)[2:] < -1e-3).all()
    assert (np.abs(track.velocity[-1000:]).max(axis=0)[2:] > 0.3).all()


@pytest.mark.parametrize(("delay", "least", "most"), [(0, 0.995, 1.0), (5, 0.97, 1.0), (20, 1.8, 2.1)])
def test_the_observer_leaves_a_stable_wall_alone_where_the_link_is_quick(delay, least, most):
    """At half the bound and 5 ms, it takes 2 % of the largest force; over 20 ms it doubles it, at first touch."""
    peaks = [
        bounce(delay, observed, 0.5, np.array([2.0]), np.array([-0.3]), seconds=1.0)[0].force.max()
        for observed in (True, False)
    ]
    assert least < peaks[0] / peaks[1] < most


def test_the_observer_adds_up_what_the_hand_got():
    """Its energy is that of the port, a round trip late."""
    controller = PassivityController(0.0, delay=7)
    memory, seen = None, []

    def host(k, position, velocity):
        nonlocal memory
        force = np.where(position < 0.0, -200.0 * position, 0.0) + 0.01
        _, _, memory = controller.correct(
            force[..., None], Motion(position[..., None], velocity[..., None]), memory
        )
        seen.append(memory.energy)
        return force

    track = simulate(host, np.array([7]), 0.01, -0.3, replace(Hand(), push=1.0), STEP, 1.0)
    taken = track.energy()[:, 0]
    assert np.array(seen)[8:, 0] == pytest.approx(taken[: len(seen) - 8], abs=1e-9)


def test_a_surplus_is_forgotten_where_nothing_acts_and_a_debt_is_not():
    """What a damper took a while ago does not pay for what a wall gives now."""
    for pull, kept in ((-1.0, 0.0), (1.0, -0.1)):
        controller, memory = PassivityController(0.0, delay=2), None
        for k in range(20):
            force = np.array([pull if k < 10 else 0.0])
            _, _, memory = controller.correct(force, Motion(np.array([0.01 * k]), np.array([10.0])), memory)
            if k == 12:
                assert memory.energy == pytest.approx(-0.1 * pull)
        assert memory.energy == pytest.approx(kept)
