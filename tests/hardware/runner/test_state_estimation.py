import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.state_estimation import MAX_SPEED_ERROR_M_S, PoseTracker, velocity
from tensionlab.model import kinematics

RIGS = ["bartels2026-validation", "seven-modules", "cube-8", "kntu-planar", "ipanema-1"]


def walk(rig, rng):
    """Yield a pose near home, drifting by some mm and mrad a step."""
    position, turn = rig.home.copy(), np.eye(rig.dimension)
    for _ in range(200):
        position = position + 1e-3 * rng.normal(size=rig.dimension)
        if rig.n > rig.dimension:
            step = 2e-3 * rng.normal(size=rig.n - rig.dimension)
            small = kinematics.exponential(step) if rig.dimension == 3 else kinematics.planar_rotation(step[0])
            turn = small @ turn
        yield position, turn


@pytest.mark.parametrize("name", RIGS)
def test_a_pose_that_drifts_is_followed_from_the_lengths_alone(name):
    rig = tl.load_rig(name)
    tracker, known = PoseTracker(rig), np.ones(rig.m, dtype=bool)
    for position, turn in walk(rig, np.random.default_rng(1)):
        rotation = None
        if rig.n > rig.dimension:
            rotation = turn if rig.dimension == 3 else np.arctan2(turn[1, 0], turn[0, 0])
        pose, structure = tracker.follow(rig.lengths(position, rotation), known)
        np.testing.assert_allclose(pose.position, position, atol=1e-6)
        np.testing.assert_allclose(structure, rig.structure_matrix(*pose), atol=1e-12)
        if rotation is not None:
            np.testing.assert_allclose(pose.rotation, rotation, atol=1e-6)


def test_what_too_few_lengths_leave_open_stays_as_it_was():
    rig = tl.load_rig("bartels2026-validation")
    tracker, known = PoseTracker(rig), np.array([False, False, False, True])
    lengths = rig.lengths(rig.home + np.array([0.0, -0.01, 0.0]))
    pose, _ = tracker.follow(lengths, known)
    np.testing.assert_allclose(pose.position, rig.home + np.array([0.0, -0.01, 0.0]), atol=1e-9)
    pose, _ = tracker.follow(np.full(4, np.nan), np.zeros(4, dtype=bool))
    np.testing.assert_allclose(pose.position, rig.home + np.array([0.0, -0.01, 0.0]), atol=1e-9)


def test_lengths_of_no_pose_are_noticed_and_the_worst_is_known():
    rig = tl.load_rig("seven-modules")
    lengths = rig.lengths(rig.home)
    lengths[4] += 0.4
    tracker = PoseTracker(rig)
    tracker.follow(lengths, np.ones(7, dtype=bool))
    assert not tracker.fits
    assert tracker.worst == 4
    assert 0.05 < tracker.error < tracker.off < 0.4
    tracker.search(rig.lengths(rig.home + 0.2), np.ones(7, dtype=bool))
    assert tracker.fits


@pytest.mark.parametrize("name", RIGS)
def test_the_velocity_is_that_of_the_lengths(name):
    rig = tl.load_rig(name)
    structure, rng = rig.structure_matrix(rig.home), np.random.default_rng(2)
    motion = rng.normal(size=rig.n)
    found = velocity(structure, -structure.T @ motion, np.ones(rig.m, dtype=bool))
    np.testing.assert_allclose(found, motion, atol=1e-9)
    tracker, known = PoseTracker(rig), rng.random(rig.m) < 0.6
    tracker.follow(rig.lengths(rig.home), np.ones(rig.m, dtype=bool))
    speeds = rng.normal(size=rig.m)
    np.testing.assert_allclose(
        tracker.native.velocity(speeds, known), velocity(structure, speeds, known), atol=1e-8
    )


def test_rigs_whose_lengths_do_not_tell_the_pose_are_refused():
    two = tl.Rig("two", "point", [tl.Module("a", [1, 0, 0], 0, 1), tl.Module("b", [0, 1, 0], 0, 1)], [0, 0, 0])
    with pytest.raises(HardwareError, match="2 cables do not fix 3 unknowns"):
        PoseTracker(two)


def test_speeds_that_no_motion_explains_are_those_of_slack_cables():
    rig = tl.load_rig("bartels2026-validation")
    structure, known = rig.structure_matrix(rig.home), np.ones(rig.m, dtype=bool)
    against = 2.0 * np.linalg.svd(structure)[2][-1]  # root mean square 1
    tracker = PoseTracker(rig)
    tracker.follow(rig.lengths(rig.home), known)
    for share, one in ((0.9, True), (1.1, False)):
        speeds = share * MAX_SPEED_ERROR_M_S * against - structure.T @ [1.0, -2.0, 3.0]
        assert tracker.moves_as_one(speeds, known) is one
