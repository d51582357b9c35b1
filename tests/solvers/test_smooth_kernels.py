"""What `analytic-centre` and `slack` have in common, and `spidar` with them: the compiled dual ascent."""

import numpy as np
import pytest
from hypothesis import given, settings

from tensionlab import Status, allocate, load_rig
from tests.helpers.examples import many
from tests.helpers.problems import cases, random_cases, random_structure

SMOOTH = ("analytic-centre", "slack", "slack:4")
each_smooth = pytest.mark.parametrize("name", SMOOTH)


@each_smooth
@pytest.mark.parametrize("rig", ["cube-8", "tetra-4"])
def test_without_a_wrench_the_middle_of_a_symmetric_rig_is_the_middle_of_the_limits(rig, name):
    rig = load_rig(rig)
    found = allocate(rig.structure_matrix(np.zeros(3)), np.zeros(3), rig.limits, name, "middle")
    np.testing.assert_allclose(found.tensions, 2.75, atol=1e-9)
    assert found.status == Status.EXACT


@pytest.mark.parametrize("name", ["analytic-centre", "slack"])
def test_parallel_cables_share_by_their_ranges(name):
    # One has half the range and pulls twice as hard: two equal shares of the wrench, x and x of -1 to 1.
    found = allocate([[2.0, 1.0]], [6.0], ([0.0, 0.0], [4.0, 8.0]), name, "middle")
    np.testing.assert_allclose(found.tensions, [1.5, 3.0], atol=1e-8)


@settings(max_examples=many(200))
@given(case=cases())
def test_awkward_problems_leave_every_tension_clear_of_its_limits(case):
    moving = case.lower < case.upper
    exact = allocate(case.structure, case.wrench, case.limits, policy="force", wrench_weights=case.weights)
    for name in SMOOTH:
        found = allocate(
            case.structure, case.wrench, case.limits, name, case.reference, wrench_weights=case.weights
        )
        assert np.all(found.tensions[moving] > case.lower[moving])
        assert np.all(found.tensions[moving] < case.upper[moving])
        assert found.iterations <= 60
        if name == "analytic-centre" and exact.status == Status.NEAREST and exact.residual > 1e-3:
            # Not proved, but near: the error is at most a little more than the least.
            assert found.residual <= exact.residual * (1 + 1e-6) + 1e-6


@each_smooth
def test_tensions_follow_the_wrench_smoothly_across_the_edge(name):
    rng = np.random.default_rng(5)
    W = random_structure(rng, 3, 8)
    wrench = W.sum(axis=1) * 3.25 + np.linspace(0.0, 20.0, 20_001)[:, None] * [0.6, 0.0, 0.8]
    found = allocate(W, wrench, (0.5, 6.0), name)
    assert found.status[0] == Status.EXACT
    assert found.status[-1] == Status.UNPROVEN
    assert np.abs(np.diff(found.tensions, axis=0)).max() < 0.01  # N for each 1e-3 N


@pytest.mark.parametrize("name", [*SMOOTH, "spidar"])
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_no_problem_takes_many_steps(name, n):
    for m in (1, 4, 8, 12, 32):
        batch = random_cases(m, max(n, 2), m, many(200))
        for stretch in (1.0, 1.5, 1e3, 1e9):
            found = allocate(batch.structure[:, :n], stretch * batch.wrench[:, :n], batch.limits, name)
            assert found.iterations.max() <= 100
            assert np.all(np.isfinite(found.tensions))
