import os

import numpy as np
import pytest

import tensionlab as tl
from benchmarks import solver_speed
from benchmarks.solver_speed import infeasible_wrenches, random_problems, time_batches, time_calls
from tensionlab.solvers import SOLVERS, as_fused_solver, make


@pytest.mark.parametrize(("n", "m"), solver_speed.SHAPES)
def test_wrenches_are_feasible_or_infeasible_as_promised(n, m):
    structure, wrench = random_problems(n, m, 300, seed=1)
    np.testing.assert_allclose(np.linalg.norm(structure[:, :3], axis=1), 1.0)
    limits = (solver_speed.LOWER, solver_speed.UPPER)
    assert (tl.allocate(structure, wrench, limits).status == tl.Status.EXACT).all()
    far = infeasible_wrenches(structure, wrench, seed=1)
    assert (tl.allocate(structure, far, limits).status == tl.Status.NEAREST).all()
    # At most twice as far as the furthest in the same direction.
    assert (tl.allocate(structure, far / 2.01, limits).status == tl.Status.EXACT).mean() > 0.7
    cosine = np.sum(far * wrench, axis=1) / np.linalg.norm(far, axis=1) / np.linalg.norm(wrench, axis=1)
    np.testing.assert_allclose(cosine, 1.0)


@pytest.mark.parametrize("feasible", [True, False])
def test_the_batch_and_daqp_agree_and_are_both_timed(monkeypatch, feasible):
    monkeypatch.setattr(solver_speed, "DAQP_CALLS", 50)
    monkeypatch.setenv("TENSIONLAB_NUM_THREADS", "3")
    row = time_batches(3, 5, feasible, count=200, rounds=2)
    assert all(1e-9 < row[name] < 1e-2 for name in ("one", "all", "c", "loop"))
    assert row["c"] < row["loop"]
    assert row["gap"] < 1e-9 if feasible else np.isnan(row["gap"])
    assert os.environ["TENSIONLAB_NUM_THREADS"] == "3"


def test_single_calls_of_all_callers():
    found = time_calls(3, 8, calls=45)
    callers = ["tl.Allocator", "tl.allocate", "daqp.solve, matrices prebuilt", 'qpsolvers.solve_qp(solver="daqp")']
    assert list(found)[:4] == callers
    families = {name for name in SOLVERS if as_fused_solver(make(name))} - {"newton", "polygon"}
    assert set(list(found)[4:]) == {f'tl.Allocator(solver="{name}")' for name in families}
    assert all(((spent > 1e-7) & (spent < 1.0)).all() for spent in found.values())
