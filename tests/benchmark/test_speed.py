import os

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark import baselines, speed
from tensionlab.benchmark.speed import (
    infeasible_wrenches,
    quantile,
    random_problems,
    shifted_geometric_mean,
    time_batches,
    time_calls,
)


def test_the_shifted_geometric_mean_by_hand():
    # (0 + 1)(3 + 1) = 4, whose root is 2; less the shift, 1.
    assert shifted_geometric_mean(np.array([0.0, 3.0, np.nan]), shift=1.0) == pytest.approx(1.0)
    # Without a shift worth mentioning: the geometric mean.
    assert shifted_geometric_mean(np.array([1.0, 100.0])) == pytest.approx(10.0, rel=1e-5)
    assert np.isnan(shifted_geometric_mean(np.array([np.nan])))


def test_a_quantile_is_a_value_that_was_measured():
    values = np.append(np.arange(1.0, 101.0), np.nan)
    assert [quantile(values, share) for share in (0.5, 0.99, 0.999, 1.0)] == [50.0, 99.0, 100.0, 100.0]
    assert quantile(np.array([7.0]), 0.999) == 7.0
    assert np.isnan(quantile(np.array([]), 0.5))


@pytest.mark.parametrize(("n", "m"), speed.SHAPES)
def test_wrenches_are_feasible_or_infeasible_as_promised(n, m):
    structure, wrench = random_problems(n, m, 300, seed=1)
    np.testing.assert_allclose(np.linalg.norm(structure[:, :3], axis=1), 1.0)
    limits = (speed.LOWER, speed.UPPER)
    assert (tl.allocate(structure, wrench, limits).status == tl.Status.EXACT).all()
    far = infeasible_wrenches(structure, wrench, seed=1)
    assert (tl.allocate(structure, far, limits).status == tl.Status.NEAREST).all()
    # At most twice as far as the furthest in the same direction.
    assert (tl.allocate(structure, far / 2.01, limits).status == tl.Status.EXACT).mean() > 0.7
    cosine = np.sum(far * wrench, axis=1) / np.linalg.norm(far, axis=1) / np.linalg.norm(wrench, axis=1)
    np.testing.assert_allclose(cosine, 1.0)


@pytest.mark.parametrize("reachable", [True, False])
def test_the_batch_and_daqp_agree_and_are_both_timed(monkeypatch, reachable):
    monkeypatch.setattr(speed, "DAQP_CALLS", 50)
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "3")
    row = time_batches(3, 5, reachable, count=200, rounds=2)
    for seconds in (row.one_core_s, row.all_cores_s, row.daqp_c_s, row.daqp_loop_s):
        assert 1e-9 < seconds < 1e-2
    assert row.daqp_c_s < row.daqp_loop_s
    assert row.ratio == row.one_core_s / row.daqp_c_s
    assert row.cores == os.cpu_count()
    assert row.gap_max < 1e-9 if reachable else np.isnan(row.gap_max)
    assert os.environ["TENSIONLAB_NUM_THREADS"] == "3"


def test_single_calls_of_all_callers():
    found = time_calls(3, 8, calls=45)
    callers = ["tl.Allocator", "tl.allocate", "daqp.solve, matrices prebuilt", 'qpsolvers.solve_qp(solver="daqp")']
    assert [call.caller for call in found] == callers
    assert all(1e-7 < call.median_s <= call.p999_s < 1.0 for call in found)
    assert all(call.quiet_p999_s <= call.p999_s for call in found)


def test_without_daqp_its_times_are_missing(monkeypatch):
    monkeypatch.setattr(baselines, "daqp_installed", lambda: False)
    row = time_batches(3, 4, count=200, rounds=1)
    assert row.one_core_s > 0
    assert np.isnan([row.daqp_c_s, row.daqp_loop_s, row.gap_max, row.ratio]).all()
    assert [call.caller for call in time_calls(3, 4, calls=20)] == ["tl.Allocator", "tl.allocate"]
