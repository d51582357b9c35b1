import numpy as np
import pytest

import tensionlab as tl
from benchmarks import highs
from benchmarks import workspace as workspace_bench
from benchmarks.workspace import closure_by_svd, closure_row, margin_row, verify, verify_suspended


@pytest.mark.parametrize(("n", "m"), workspace_bench.SHAPES)
def test_the_margin_has_the_sign_that_highs_finds(n, m):
    found = verify(n, m, 1500)
    assert found.poses == 1500
    assert 0.1 < found.feasible / found.poses < 0.9
    assert found.undecided < 3
    assert found.contradicted == 0


@pytest.mark.parametrize("name", workspace_bench.SUSPENDED)
def test_what_a_suspended_robot_holds_is_what_linprog_finds(name):
    found = verify_suspended(name, 150)
    assert 0 < found.feasible < found.poses == 150
    assert found.undecided == 0
    assert found.contradicted == 0


def test_a_contradiction_is_counted(monkeypatch):
    monkeypatch.setattr(workspace_bench, "capacity_margin", lambda *given: -tl.workspace.capacity_margin(*given))
    found = verify(3, 4, 100)
    assert found.contradicted == 100 - found.undecided


def test_the_metric_and_its_baselines_are_timed(monkeypatch):
    monkeypatch.setattr(workspace_bench, "BASELINE_CALLS", 16)
    margin = margin_row(3, 5, 50, rounds=1)
    closure = closure_row(1.0, rounds=1)
    assert (margin.poses, closure.poses) == (50, 9 * 7 * 3)
    assert np.isnan(margin.numpy_s)
    for seconds in (margin.one_core_s, margin.all_cores_s, margin.highs_s, margin.linprog_s, closure.numpy_s):
        assert 1e-9 < seconds < 1.0


def test_highs_says_what_tensions_can_do():
    lower, upper = np.zeros(2), np.full(2, 2.0)
    asked = [np.array([1.5, 0.5]), np.array([-0.1, 0.0]), np.array([2.0, 2.0])]
    models = [highs.model(np.eye(2), wrench, lower, upper) for wrench in asked]
    assert highs.feasibility_checker()(models) == [True, False, True]


def test_closure_by_singular_values_is_that_of_the_package():
    rng = np.random.default_rng(0)
    W = rng.normal(size=(300, 3, 5))
    W[::2, :, 0] -= W[::2].sum(axis=-1)
    assert np.array_equal(closure_by_svd(W), tl.workspace.wrench_closure(W))
    W[:, 2] = W[:, 1]
    assert not closure_by_svd(W).any()
