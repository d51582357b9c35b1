"""Friction of winch and pulley, compensated in a run: simulated modules with known friction, in both ways."""

import math
from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.demand import Demand, Pose
from tensionlab.hardware.runner import guard
from tensionlab.hardware.runner.guard import FrictionCompensation
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.world import World
from tests.haptics.rendering.test_renderer import Hand

COULOMB, VISCOUS = 0.15, 0.1
PLANT = {"cogging": 0.0, "damping": 25.0}
HOME = tl.load_rig("bartels2026-validation").home


def rig(share=1.0):
    """A rig that says a share of the friction that its modules have; lower limits leave modules 0.2 N below."""
    found = tl.load_rig("bartels2026-validation")
    known = {"friction_coulomb": share * COULOMB or None, "friction_viscous": share * VISCOUS or None}
    return replace(found, modules=tuple(replace(module, lower=0.7, **known) for module in found.modules))


def run(believed, motion, demand, *, latency=0.0, rate=50.0, seconds=2.5, own=0.0):
    """Run, and return true tensions, those commanded, measured ones and speeds, cycle by cycle."""
    world = World(rig(), motion, plants={module.name: PLANT for module in believed.modules})
    group, rows = world.group(Conditions(latency)), []
    for client in group.clients:
        client.set_parameter("tension_lower", 0.5)
        client.set_parameter("friction_coulomb", own * COULOMB)
        client.set_parameter("friction_viscous", own * VISCOUS)

    def source(state):
        if runner.latest is not None:
            rows.append((world.tensions, runner.latest.commanded, state.tensions, state.speeds))
        else:  # cables are taken up with no more than the minimum tension
            assert max(module.sample.commanded for module in world.modules) < 0.5 + 1e-6
        return Demand(np.array(demand))

    runner = Runner(believed, group, "newton", source, RunSettings(rate), clock=WorldClock(world))
    runner.run(seconds)
    return [np.array(column) for column in zip(*rows, strict=True)]


def to_and_fro(time):
    return Pose(HOME + np.array([0.05 * math.sin(2.0 * math.pi * time), 0.0, 0.0]))


@pytest.mark.parametrize(("latency", "rate"), [(0.0, 50.0), (0.01, 200.0), (0.02, 50.0)])
def test_cables_pull_as_commanded_in_both_directions(latency, rate):
    errors = {}
    for share, own in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)):  # not at all; by the runner; by the module
        true, commanded, _, speeds = run(rig(share), to_and_fro, [0, 1.5, 0], latency=latency, rate=rate, own=own)
        steady = slice(round(rate), None)
        error, speed = (true - commanded)[steady], speeds[steady]
        errors[share, own] = [error[speed > 0.05].mean(), error[speed < -0.05].mean()]
    moving = COULOMB + VISCOUS * 0.14  # mean speed of the cables
    np.testing.assert_allclose(errors[0.0, 0.0], [moving, -moving], atol=0.015)
    assert np.abs(errors[1.0, 0.0]).max() < 0.1 * moving
    assert np.abs(errors[1.0, 1.0]).max() < 0.25 * moving  # once, not twice


def test_measured_tensions_are_those_of_the_cables():
    for share, least, most in ((0.0, 0.13, 0.2), (1.0, 0.0, 0.09)):
        true, _, measured, speeds = run(rig(share), to_and_fro, [0, 1.5, 0], rate=200.0)
        fast = np.abs(speeds[200:]) > 0.05
        assert least < np.sqrt(np.mean((true - measured)[200:][fast] ** 2)) < most


@pytest.mark.parametrize("latency", [0.0, 0.02])
@pytest.mark.parametrize("damping", [0.2, 2.0])
def test_a_hand_comes_to_rest_although_its_friction_is_overestimated(latency, damping, monkeypatch):
    """1.5 times, as with cogging that `calibrate gain` counts; without a dead band that would be a limit cycle."""

    def swing():
        hand = Hand(HOME + np.array([0.03, 0.0, 0.0]), lambda place: -20.0 * (place - HOME), damping=damping)
        run(rig(1.5), hand, [0.0, 0.0, 0.0], latency=latency, seconds=4.0)
        return np.ptp(np.array(hand.path[-1000:]), axis=0).max()

    assert swing() < 5e-5
    monkeypatch.setattr(guard, "FRICTION_DEAD_BAND_M_S", 1e-6)
    assert swing() > 5e-3


def test_friction_has_the_sign_of_the_speed_outside_a_dead_band():
    friction = FrictionCompensation(rig(), [(0.05, 0.3)] * 4)
    speeds = np.array([0.009, -0.5, 0.5, math.nan])
    np.testing.assert_allclose(friction.force(speeds), [0.0, -0.1, 0.1, 0.0], atol=1e-12)
