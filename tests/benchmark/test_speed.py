import os

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark import baselines, speed
from tensionlab.benchmark.speed import infeasible_wrenches, random_problems, time_batches, time_calls


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


def test_without_daqp_its_columns_are_empty(monkeypatch):
    monkeypatch.setattr(baselines, "daqp_installed", lambda: False)
    row = time_batches(3, 4, count=200, rounds=1)
    assert row.one_core_s > 0
    assert np.isnan([row.daqp_c_s, row.daqp_loop_s, row.gap_max, row.ratio]).all()


def test_single_calls_of_all_callers_daqp_with_its_matrices_prebuilt_and_not():
    found = time_calls(3, 8, calls=45)
    assert [call.caller for call in found] == [
        "tl.Allocator", "tl.allocate", "daqp.solve, matrices prebuilt",
        "daqp.solve, matrices built in each call", 'qpsolvers.solve_qp(solver="daqp")',
    ]  # fmt: skip
    assert all(1e-7 < call.median_s <= call.p999_s < 1.0 for call in found)
    assert all(call.quiet_p999_s <= call.p999_s for call in found)


def test_without_daqp_its_rows_are_missing(monkeypatch):
    monkeypatch.setattr(baselines, "daqp_installed", lambda: False)
    assert [call.caller for call in time_calls(3, 4, calls=20)] == ["tl.Allocator", "tl.allocate"]
