"""Jumps of tensions along paths: known ones, none where there is none, and steep changes that are none."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import tensionlab as tl
from benchmarks.continuity import measure as measure_rig
from tensionlab.benchmark.continuity import measure_continuity, path_of

SUSPENDED = np.array([[-0.6, 0.6], [0.8, 0.8]])  # two cables from above


def measure(allocator, path, samples):
    """Return jumps and steps on a path with this number of samples."""
    return measure_continuity(allocator, path, allocator(*path(np.arange(float(samples)))))


def turning(parameter):
    """Return a force of 20 N that turns by 0.4 rad over 40 samples through the corner of what is feasible."""
    angle = np.arctan2(8.8, 5.4) + 0.01 * (parameter - 20.3)
    force = 20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.broadcast_to(SUSPENDED, (len(angle), 2, 2)), force


@pytest.mark.parametrize(("policy", "jump"), [("direction", 3.561), ("force", 0.0), ("tension", 0.0)])
def test_the_direction_policy_jumps_where_the_zero_wrench_is_infeasible(policy, jump):
    found = measure(tl.Allocator((1.0, 10.0), policy=policy), turning, 40)
    assert found.beyond == pytest.approx(jump, abs=1e-3)


@pytest.mark.parametrize("width", [0.5, 0.1, 0.01])
def test_a_steep_change_is_no_jump(width):
    def rise(parameter):
        pull = 3.0 * np.clip((parameter - 5.3) / width, 0.0, 1.0)
        return np.broadcast_to([[1.0, -1.0]], (len(pull), 1, 2)), pull[:, None]

    found = measure(tl.Allocator((1.0, 5.0)), rise, 10)
    assert (found.jump, found.step) == (0.0, pytest.approx(3.0))


def test_linear_programs_jump_on_suspended_robots_and_quadratic_ones_do_not():
    jumps = {(solver, policy): jump for _, solver, policy, _, jump, *_ in measure_rig("caroca", segments=4)}
    assert jumps.pop(("least-sum", None)) > 24.0
    assert jumps.pop(("minimax", None)) == jumps.pop(("safe", None)) == 0.0
    assert ("polygon:centroid", None) in jumps
    assert set(jumps.values()) == {0.0}


def test_beyond_what_is_feasible_tensions_jump_in_the_plane_of_cables():
    rig = tl.load_rig("bartels2026-validation")
    position = np.array([[-0.064, 0.01, 0.065], [-0.064, -0.01, 0.065]])
    path = path_of(rig, position, None, np.tile([1.0, 0.02, -0.16], (2, 1)))
    found = measure(tl.Allocator(rig.limits), path, 2)
    assert found.jump == 0.0
    assert found.beyond > 3.0


def test_a_platform_turns_evenly_between_samples():
    rig = tl.load_rig("cogiro")
    none, half, whole = Rotation.from_rotvec(np.outer([0.0, 0.15, 0.3], [0.0, 0.0, 1.0])).as_matrix()
    path = path_of(rig, np.tile(rig.home, (2, 1)), np.stack([none, whole]), np.zeros((2, 6)))
    np.testing.assert_allclose(path(np.array([0.5]))[0][0], rig.structure_matrix(rig.home, half), atol=1e-12)
