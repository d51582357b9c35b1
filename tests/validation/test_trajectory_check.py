"""Checks of trajectories against simulated motors, and against poses and wrenches one by one."""

import dataclasses

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.validation.trajectory_check import check_trajectory, winding_speed
from tests.helpers.modules import armed

MODULE = tl.Module("winch", [0.0, 0.0, 0.0], 0.5, 6.0, newton_per_ampere=3.0, spool_radius=0.0195)
_, Y, Z = np.eye(3)


def checks(rig, path, **options):
    found, winches = check_trajectory(rig, path, tl.inverse_dynamics(rig, path, **options))
    return {each.name: each for each in found}, winches


@pytest.mark.parametrize("tension", [4.5, 5.5])
def test_a_simulated_motor_winds_at_its_tension_up_to_the_speed_and_pulls_less_beyond(tension):
    limit = float(winding_speed(MODULE, np.array(tension)))
    pulled = {}
    for speed in (0.85 * limit, 1.4 * limit):
        host = armed(parameters={"speed_limit": 10.0})
        host.hold(tension, 0.3)
        start = host.module.sample.distance
        traces = host.hold(tension, 0.3, distance=start - 0.3 * speed)
        pulled[speed] = np.mean(np.concatenate([trace.tension for trace in traces[-5:]]))
    slow, fast = pulled.values()
    assert slow == pytest.approx(tension, abs=0.25)
    assert fast < tension - 0.5


def test_speeds_are_those_of_the_lengths_and_findings_name_the_worst_sample():
    rig = tl.load_rig("bartels2026-validation")
    modules = tuple(dataclasses.replace(each, newton_per_ampere=3.0, spool_radius=0.02) for each in rig.modules)
    rig = dataclasses.replace(rig, modules=modules, platform=tl.Platform(0.2))
    path = tl.Trajectory.through([rig.home, rig.home + 0.3 * Y], [0.0, 0.3], step=0.001)
    found, winches = checks(rig, path)
    rates = np.diff(rig.lengths(path.position), axis=0) / 0.001
    rows = {row[0]: row for row in winches}
    for number, module in enumerate(rig.modules):
        np.testing.assert_allclose(rows[module.name][5], max(0.0, rates[:, number].max()), atol=0.02)
        np.testing.assert_allclose(rows[module.name][6], max(0.0, -rates[:, number].min()), atol=0.02)
    assert found["tensions"].passed
    assert found["motors"].passed is False
    assert "top winds at 1.88 m/s and can 1.5 m/s" in found["motors"].text
    slower = tl.Trajectory.through(path.position[[0, -1]], [0.0, 0.6], step=0.01)
    assert checks(rig, slower)[0]["motors"].passed
    heavy, _ = checks(rig, slower, payload=20.0)
    assert heavy["tensions"].passed is False
    assert heavy["tensions"].text.startswith("infeasible at ")


def test_the_clearance_is_to_the_bodies_along_the_way():
    rig = tl.load_rig("bartels2026-validation")
    head = tl.Body("head", [0.0, 1.2, -0.3], radius=0.12, margin=0.1)
    rig = dataclasses.replace(rig, bodies=(head,), platform=tl.Platform(0.1))
    for side, passed in ((0.2, True), (-0.2, False)):
        found, _ = checks(rig, tl.Trajectory.through([rig.home, rig.home + side * Z], [0.0, 2.0]))
        assert found["bodies"].passed is passed
        assert "from head" in found["bodies"].text
    distance, _ = tl.workspace.body_distance(rig, rig.home - 0.2 * Z)
    assert f"is {distance:.3f} m from head at 2 s" in found["bodies"].text
