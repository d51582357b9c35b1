"""The direction policy at its edges: where a wrench grazes what can be rendered, or leaves a rig that is flat."""

from __future__ import annotations

import numpy as np
import pytest

import tensionlab as tl

LIMITS = (0.5, 6.0)
TOLERANCE = 1e-6
ALONG = [[1.0, -1.0], [0.0, 0.0]]  # two cables along a line: nothing can be rendered across it
ANGLES = np.radians([90.0, 210.0, 330.0])
# Three modules on a floor, the hand on it as well.
FLOOR = np.stack([np.cos(ANGLES), np.sin(ANGLES), 0.0 * ANGLES])
# Cables that may be slack: what can be rendered begins at a corner, and w grazes one of its sides.
WEDGE = ([[1.0, 0.6], [0.0, 0.8]], (0.0, 6.0))
FOLLOWERS = ("newton", "qp:daqp", "qp:clarabel", "cvxpy")


def test_a_wrench_at_a_corner_and_the_hand_almost_in_a_line_of_anchors_ends():
    # Found on the published rig: the step from one scale to the next was less than a rounding.
    rig = tl.load_rig("datasets/rigs/bartels2026-validation.toml")
    structure = rig.structure_matrix([0.15674991955083237, 1.3660854928855298e-08, 0.03740702398990891])
    wrench = [-2.048109466505713, 0.49877675394167476, -0.8370705891369621]
    for policy in ("force", "tension", "direction"):
        found = tl.allocate(structure, wrench, rig.limits, policy=policy)
        assert found.status == tl.Status.EXACT
        assert found.iterations < 400


@pytest.mark.parametrize("solver", FOLLOWERS)
@pytest.mark.parametrize("across", [0.0, 1e-12, 1e-9, 1e-7, 0.9e-6])
def test_what_force_renders_direction_renders(solver: str, across: float):
    for structure, wrench, limits in (
        (ALONG, [2.0, across], LIMITS),
        (FLOOR, [1.0, 0.5, across], LIMITS),
        (WEDGE[0], [2.0, -across], WEDGE[1]),
    ):
        found = tl.allocate(structure, wrench, limits, solver, policy="direction")
        if structure is WEDGE[0] and solver != "newton":
            # An interior point of the cables' limits comes near their corner, not into it.
            assert found.status == tl.allocate(structure, wrench, limits, solver, policy="force").status
        else:
            assert found.status == tl.Status.EXACT
            assert found.residual <= TOLERANCE * np.linalg.norm(wrench)


@pytest.mark.parametrize("wedge", [False, True], ids=["flat", "wedge"])
def test_the_rendered_wrench_falls_off_gradually(wedge: bool):
    # From a plane, or from a side of a wedge: the part that is rendered falls with the distance, in no leap.
    across = np.geomspace(1e-9, 1.0, 20_000)
    structure, limits = WEDGE if wedge else (ALONG, LIMITS)
    wrench = np.stack([np.full_like(across, 2.0), -across if wedge else across], axis=-1)
    found = tl.allocate(structure, wrench, limits, policy="direction")
    assert found.counts()[tl.Status.UNPROVEN] == 0
    scale = found.scale
    assert scale[0] == 1.0
    assert scale[-1] == pytest.approx(0.0, abs=1e-6)
    assert (np.diff(scale) <= 1e-7).all()
    assert np.abs(np.diff(found.wrench[:, 0])).max() < 0.005
    half = np.interp(-0.5, -scale, across)
    assert 1e-6 < half < 1e-5  # a few tolerances


@pytest.mark.parametrize("solver", FOLLOWERS)
def test_every_solver_with_the_policy_falls_off_alike(solver: str):
    wrench = np.stack([np.full(5, 2.0), [0.5e-6, 3e-6, 1e-5, 1e-3, 0.5]], axis=-1)
    found = tl.allocate(ALONG, wrench, LIMITS, solver, policy="direction")
    assert (found.status <= tl.Status.NEAREST).all()
    truth = tl.allocate(ALONG, wrench, LIMITS, policy="direction")
    np.testing.assert_allclose(found.scale, truth.scale, atol=1e-3)  # programs end at a small error of their own


def test_a_wrench_that_is_a_hair_out_of_reach_is_exact_whatever_the_angle():
    # At an angle to the face, the part along the direction falls short by more than the nearest wrench misses.
    structure, limits = WEDGE
    rng = np.random.default_rng(1)
    angle = rng.uniform(0.0, 2 * np.pi, 500)
    wrench = 20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    edge = tl.allocate(structure, wrench, limits, policy="direction")
    keep = edge.scale > 0.1
    hair = edge.wrench[keep] * (1 + 1e-6 * rng.uniform(0.0, 2.0, (keep.sum(), 1)))
    force = tl.allocate(structure, hair, limits, policy="force").status
    assert 0 < (force == 0).sum() < keep.sum()
    assert (tl.allocate(structure, hair, limits, policy="direction").status == force).all()


def test_where_cables_hang_the_direction_jumps_and_the_other_policies_do_not():
    """Two cables pull up with 1.6 N at least, and a wrench grazes what they render."""
    edge, structure = np.arctan2(8.8, 5.4), [[-0.6, 0.6], [0.8, 0.8]]
    wrenches = [[20.0 * np.cos(edge + turn), 20.0 * np.sin(edge + turn)] for turn in (-5e-6, 5e-6)]
    change = {
        policy: np.ptp(tl.allocate(structure, wrenches, (1.0, 10.0), policy=policy).tensions, axis=0).max()
        for policy in ("direction", "force", "tension")
    }
    assert change["direction"] > 3.0
    assert max(change["force"], change["tension"]) < 1e-3
