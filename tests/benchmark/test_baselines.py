"""Baselines on the plain program: their replies are passed on unclipped, with reasons where there are none."""

import numpy as np
import pytest

from tensionlab.benchmark.baselines import TIGHT, DirectDaqp, PlainConvex, PlainProgram
from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers.quadratic import BACKENDS, import_qpsolvers

qpsolvers = import_qpsolvers()  # without JAX
# Least |t|² of three cables that pull 9 N together, one with at least 5 N, one with at most 1 N.
ROWS = np.array([[1.0, 1.0, 1.0]])
WRENCH, LOWER, UPPER = np.array([9.0]), np.array([5.0, 0.0, 0.0]), np.array([8.0, 1.0, 9.0])
BEST = [5.0, 1.0, 3.0]

BASELINES = {
    **{f"{name}, default": lambda name=name: PlainProgram(name) for name in BACKENDS},
    **{f"{name}, tight": lambda name=name: PlainProgram(name, "tight") for name in TIGHT},
    "direct, default": DirectDaqp,
    "direct, tight": lambda: DirectDaqp("tight"),
    "cvxpy, default": PlainConvex,
    "cvxpy, tight": lambda: PlainConvex("tight"),
}
each_baseline = pytest.mark.parametrize("name", BASELINES)


# Backends warn of what is measured here, and OSQP of its own future.
pytestmark = pytest.mark.filterwarnings("ignore")


def ask(baseline, wrench=WRENCH):
    program = baseline.build(ROWS, wrench, LOWER, UPPER)
    result = baseline.run(program)
    return result if isinstance(result, Exception) else baseline.read(program, result)


@each_baseline
def test_every_baseline_finds_the_least_squares(name):
    reply = ask(BASELINES[name]())
    np.testing.assert_allclose(reply.tensions, BEST, atol=1e-6 if "tight" in name else 1e-2)


@each_baseline
def test_out_of_reach_a_baseline_breaks_nothing(name):
    reply = ask(BASELINES[name](), np.array([900.0]))
    if not isinstance(reply, Exception) and reply.tensions is not None:
        assert np.isfinite(reply.tensions).all()


@pytest.mark.parametrize("x", [None, np.array([np.nan, 1.0, 1.0]), np.zeros(0)])
def test_no_tensions_are_a_failure_with_a_reason(monkeypatch, x):
    solve = qpsolvers.solve_problem

    def nothing(program, solver, **settings):
        solution = solve(program, solver, **settings)
        solution.x = x
        return solution

    monkeypatch.setattr(qpsolvers, "solve_problem", nothing)
    reply = ask(PlainProgram("daqp"))
    assert reply.tensions is None
    assert "no finite tensions" in reply.failure


def test_what_a_baseline_throws_is_its_result(monkeypatch):
    def throw(*_, **__):
        raise qpsolvers.exceptions.SolverError("out of steam")

    monkeypatch.setattr(qpsolvers, "solve_problem", throw)
    assert str(ask(PlainProgram("daqp"))) == "out of steam"


def test_what_cannot_run_is_refused(request):
    with pytest.raises(UnknownSolver, match=r"'cplex'.*clarabel"):
        PlainProgram("cplex")
    with pytest.raises(ValueError, match="quadprog has no options"):
        PlainProgram("quadprog", "tight")
    request.getfixturevalue("only_clarabel")
    with pytest.raises(MissingDependency, match=r"tensionlab\[solvers\]"):
        PlainProgram("daqp")
