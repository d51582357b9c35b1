"""Quadratic programs: every backend, every policy, and what happens when a backend breaks."""

import numpy as np
import osqp
import pytest

from tensionlab import allocate
from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers.quadratic import BACKENDS, QuadraticProgram, import_qpsolvers, installed_backends
from tests.helpers.batch import problem

qpsolvers = import_qpsolvers()  # without JAX
PLANAR = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]])

each_backend = pytest.mark.parametrize("backend", installed_backends())
each_policy = pytest.mark.parametrize("policy", QuadraticProgram.policies)


def test_all_backends_of_the_extra_are_there():
    assert installed_backends() == tuple(BACKENDS)


@each_backend
def test_cables_that_pull_nothing_stay_at_the_reference(backend):
    answer = QuadraticProgram(backend).solve(problem(np.zeros((2, 2)), [1, 7], 1, 5))
    np.testing.assert_array_equal(answer.tensions, [[1, 1]])


@each_policy
def test_the_unit_of_tension_does_not_matter(policy):
    for unit in (1e-3, 1e3):
        answer = QuadraticProgram().solve(problem(PLANAR, np.array([12, 6]) * unit, unit, 10 * unit, policy))
        ours = QuadraticProgram().solve(problem(PLANAR, [12, 6], 1, 10, policy))
        np.testing.assert_allclose(answer.tensions / unit, ours.tensions, atol=1e-6)


def break_second(monkeypatch, effect):
    """Let the backend break in the second program that it is given."""
    solve, calls = qpsolvers.solve_problem, []

    def patched(program, solver, **settings):
        calls.append(solver)
        solution = solve(program, solver, **settings)
        return effect(solution) if len(calls) == 2 else solution

    monkeypatch.setattr(qpsolvers, "solve_problem", patched)


@pytest.mark.parametrize(
    ("backend", "error"), [("daqp", qpsolvers.exceptions.SolverError), ("osqp", osqp.OSQPException)]
)
def test_a_backend_that_throws_is_a_failure_of_that_row_alone(backend, error, monkeypatch):
    def throw(solution):
        raise error("ran out of steam")

    break_second(monkeypatch, throw)
    answer = QuadraticProgram(backend).solve(problem([[1, 1]], [[4], [5], [6]], 0, 9))
    assert answer.failures == {1: f"{backend}: {error.__name__}: ran out of steam"}
    assert np.isnan(answer.tensions[1]).all()
    np.testing.assert_allclose(answer.tensions[[0, 2]], [[2, 2], [3, 3]])


def test_a_mistake_of_ours_is_not_called_a_failure_of_the_backend(monkeypatch):
    def slip(solution):
        raise TypeError("no such argument")

    break_second(monkeypatch, slip)
    with pytest.raises(TypeError, match="no such argument"):
        QuadraticProgram("daqp").solve(problem([[1, 1]], [[4], [5], [6]], 0, 9))


@pytest.mark.parametrize("x", [None, np.array([np.nan, 1.0]), np.zeros(0), np.array([9.0, 9.0])])
def test_whatever_a_backend_claims_its_x_is_measured(monkeypatch, x):
    def lie(solution):
        solution.found, solution.x = True, x
        return solution

    break_second(monkeypatch, lie)
    answer = QuadraticProgram("daqp").solve(problem([[1, 1]], [[4], [5], [6]], 0, 9))
    np.testing.assert_allclose(answer.tensions, [[2, 2], [2.5, 2.5], [3, 3]], atol=1e-6)


def test_no_tensions_at_all_is_a_failure(monkeypatch):
    solve = qpsolvers.solve_problem

    def silent(program, solver, **settings):
        solution = solve(program, solver, **settings)
        solution.x = None
        return solution

    monkeypatch.setattr(qpsolvers, "solve_problem", silent)
    answer = QuadraticProgram("daqp").solve(problem([[1, 1]], [4], 0, 9))
    assert "gave no tensions" in answer.failures[0]
    assert np.isnan(answer.tensions).all()


def test_the_name_of_a_backend_alone_is_answered_with_its_full_name():
    with pytest.raises(UnknownSolver, match="no solver is called 'daqp'; did you mean 'qp:daqp'"):
        allocate([[1.0, -1.0]], [2.0], (1.0, 5.0), "daqp")


@pytest.mark.usefixtures("only_clarabel")
def test_a_missing_backend_names_the_extra():
    assert installed_backends() == ("clarabel",)
    with pytest.raises(MissingDependency, match=r"'daqp'.*pip install \"tensionlab\[solvers\]\""):
        QuadraticProgram("daqp").solve(problem([[1, 1]], [4], 0, 9))


def test_iterations_are_counted_where_the_backend_tells():
    batch = problem(PLANAR, [[1, 1], [12, 6]], 1, 10)
    for backend in ("osqp", "quadprog", "piqp", "proxqp"):
        assert (QuadraticProgram(backend).solve(batch).iterations > 0).all()
