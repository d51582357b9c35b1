"""Accelerations that a requirement asks for, against Newton and Euler at random ones, and trajectories."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.model.kinematics import exponential
from tensionlab.model.requirement import around_ball
from tests.helpers.reference_metrics import renders

INERTIA = [[4.0, 0.3, 0.0], [0.3, 6.0, -0.2], [0.0, -0.2, 5.0]]
BODY = tl.Platform(20.0, com=[0.1, -0.2, 0.3], inertia=INERTIA)
PLATFORM = tl.Rig(
    "body", "platform", tl.load_rig("ipanema-1").modules, home=[0.0, 0.0, 1.0], platform=BODY, up="z"
)
FLAT = tl.Rig(
    "flat",
    "planar",
    tl.load_rig("kntu-planar").modules,
    home=[0.0, 0.0],
    platform=tl.Platform(5.0, com=[0.1, 0.05], inertia=[[0.4]]),
    up="y",
)


def turned(rig, rng, angle=0.5):
    """Return a random orientation and its matrix in space."""
    turn = rng.uniform(-angle, angle, 3)
    if rig.dimension == 3:
        return exponential(turn), exponential(turn)
    return turn[2], exponential(np.array([0.0, 0.0, turn[2]]))


def wrench_of(rig, acceleration, R, gravity):
    """Return the wrench that accelerates the centre of mass and turns the platform from rest, (n,)."""
    d, n = rig.dimension, rig.n
    linear, angular, up, com = np.zeros((4, 3))
    linear[:d], up[:d], com[:d] = acceleration[:d], rig.upward, rig.platform.com
    force = rig.platform.mass * (linear + (9.81 * up if gravity else 0.0))
    inertia = np.zeros((3, 3))
    inertia[3 - len(rig.platform.inertia) :, 3 - len(rig.platform.inertia) :] = rig.platform.inertia
    angular[3 - (n - d) :] = acceleration[d:]
    torque = np.cross(R @ com, force) + R @ inertia @ R.T @ angular
    return np.concatenate([force, torque])[[0, 1, 5] if d == 2 else slice(None)]


@pytest.mark.parametrize("rig", [PLATFORM, FLAT], ids=str)
@pytest.mark.parametrize("gravity", [True, False])
def test_corners_are_those_of_a_box_of_accelerations(rig, gravity):
    rng = np.random.default_rng(0)
    half = rng.uniform(0.5, 3.0, rig.n)
    required = tl.Requirement(acceleration=half, gravity=gravity)
    for _ in range(5):
        rotation, R = turned(rig, rng)
        corners = required.at(rig, rotation)
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * rig.n, indexing="ij"), axis=-1).reshape(-1, rig.n)
        expected = [wrench_of(rig, half * sign, R, gravity) for sign in signs]
        np.testing.assert_allclose(corners, expected, atol=1e-12)
    both = tl.Requirement(acceleration=half[: rig.dimension], box=np.ones(rig.n)).at(rig)
    assert both.shape == (2**rig.n * 2**rig.dimension, rig.n)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_polytope_of_a_ball_contains_it(dimension):
    corners = around_ball(dimension)
    assert ConvexHull(corners).equations[:, -1].max() <= -1 + 1e-12
    assert np.linalg.norm(corners, axis=1).max() < (1.02 if dimension == 2 else 1.071)


@pytest.mark.parametrize("rig", [PLATFORM, FLAT], ids=str)
def test_torques_change_within_an_angle_by_no_more_than_said(rig):
    rng, angle = np.random.default_rng(1), 0.2
    required = tl.Requirement(acceleration=rng.uniform(0.5, 3.0, rig.n), gravity=True)
    most = required.turned_torque(rig, angle)
    changes = []
    for _ in range(200):
        start, R = turned(rig, rng)
        axis = rng.normal(size=3)
        turn = exponential(angle * axis / np.linalg.norm(axis))
        end = turn @ R if rig.dimension == 3 else start + angle
        changes.append(np.linalg.norm((required.at(rig, end) - required.at(rig, start)), axis=1).max())
    assert 0.3 * most < max(changes) <= most


def test_a_trajectory_from_rest_has_the_wrenches_of_its_accelerations():
    rig = tl.load_rig("cogiro")
    required = tl.Requirement(acceleration=[1.0, 2.0, 0.5], gravity=True)
    rig = tl.Rig(rig.name, rig.kind, rig.modules, rig.home, rig.platform, up="z", required=required)
    acceleration = np.array([[1.0, 2.0, 0.5], [-1.0, 2.0, -0.5]])
    trajectory = tl.Trajectory([0.0, 1.0], [rig.home] * 2, None, np.zeros((2, 3)), acceleration)
    corners = required.at(rig)
    for wrench in tl.inverse_dynamics(rig, trajectory):
        assert np.abs(corners - wrench).max(axis=1).min() < 1e-9


@pytest.mark.parametrize("acceleration", [[1.5, 1.0, 0.8], 1.2, [0.6, 0.6, 0.4, 0.5, 0.4, 0.6]], ids=str)
def test_proved_poses_render_random_accelerations(acceleration):
    rig, rng = tl.load_rig("cogiro"), np.random.default_rng(2)
    platform = tl.Platform(rig.platform.mass, rig.platform.com, np.diag([20.0, 25.0, 30.0]))
    rig = tl.Rig(rig.name, rig.kind, rig.modules, rig.home, platform, up="z")
    required = tl.Requirement(acceleration=acceleration, gravity=True)
    region = [(-7, 7), (-5, 5), (0, 5)]
    proved = tl.workspace.certify(rig, region, required, 0.8)
    at = rng.uniform(*np.array(region).T, (40_000, 3))
    verdict, structure = proved.at(at), rig.structure_matrix(at)
    assert {1, -1} <= set(verdict)
    for row in rng.choice(np.flatnonzero(verdict == 1), 150):
        if np.ndim(acceleration):
            sample = rng.uniform(-1, 1, len(acceleration)) * acceleration
            sample = np.where(rng.random(len(sample)) < 0.5, np.copysign(acceleration, sample), sample)
        else:
            sample = rng.normal(size=3)
            sample *= acceleration / np.linalg.norm(sample)
        wrench = wrench_of(rig, np.pad(sample, (0, 6 - len(sample))), np.eye(3), True)
        assert renders(structure[row], rig.limits.lower, rig.limits.upper, wrench)
    for row in rng.choice(np.flatnonzero(verdict == -1), 20):
        limits = rig.limits.lower, rig.limits.upper
        assert not all(renders(structure[row], *limits, each) for each in required.at(rig))
    swept = tl.sweep(rig, tl.workspace.PoseList(at[:500]), "wrench-feasible", required=required)
    feasible = swept["wrench-feasible"].values[0] > 0
    assert feasible[verdict[:500] == 1].all()
    assert not feasible[verdict[:500] == -1].any()


@pytest.mark.parametrize(
    ("acceleration", "rig", "words"),
    [
        ([1.0, -1.0, 1.0], PLATFORM, "give half of each edge of a box, or one number"),
        ([[1.0]], PLATFORM, "half of each edge"),
        ([1.0, 1.0], PLATFORM, "has 2 components; body, a platform rig, needs 3 or 6"),
        (1.0, tl.load_rig("tetra-4"), 'tetra-4 has no mass; its file needs .platform. with "mass"'),
        ([1.0] * 6, dataclasses.replace(PLATFORM, platform=tl.Platform(1.0)), 'no inertia; .*"inertia"'),
    ],
)
def test_accelerations_that_do_not_suit_the_rig_are_refused(acceleration, rig, words):
    with pytest.raises(RigError, match=words):
        tl.Requirement(acceleration=acceleration).at(rig)


@pytest.mark.parametrize("acceleration", [2.0, [1.0, 2.0, 3.0]])
def test_files_keep_accelerations(acceleration, tmp_path):
    rig = dataclasses.replace(PLATFORM, required=tl.Requirement(acceleration=acceleration))
    tl.save_rig(rig, tmp_path / "rig.toml")
    assert tl.load_rig(tmp_path / "rig.toml") == rig
