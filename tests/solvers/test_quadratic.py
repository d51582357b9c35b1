"""Quadratic programs: every backend, every policy, and what happens when a backend breaks."""

import json
from pathlib import Path

import numpy as np
import pytest
import qpsolvers

from tensionlab import Status, allocate
from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers.quadratic import BACKENDS, QuadraticProgram, installed_backends
from tests.helpers.batch import problem

ANSWERS = Path(__file__).parents[1] / "data" / "known_answers.json"
CASES = json.loads(ANSWERS.read_text(encoding="utf-8"))["cases"]
PLANAR = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]])

each_backend = pytest.mark.parametrize("backend", installed_backends())
each_policy = pytest.mark.parametrize("policy", QuadraticProgram.policies)


def test_all_backends_of_the_extra_are_there():
    assert installed_backends() == tuple(BACKENDS)


@each_backend
@pytest.mark.parametrize("key", ["zero", "fmin", "mid"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_known_answers(case, key, backend):
    lower, upper = np.array(case["fmin"]), np.array(case["fmax"])
    reference = {"zero": None, "fmin": "lower", "mid": "middle"}[key]
    result = allocate(case["W"], case["wrench_to_produce"], (lower, upper), f"qp:{backend}", reference)
    assert result.status == Status.EXACT
    np.testing.assert_allclose(result.tensions, case[f"min2_from_{key}"], rtol=0, atol=1e-6)


@each_backend
@pytest.mark.parametrize(
    ("policy", "tensions", "scale"),
    [
        ("tension", (10, 575 / 122, 1), None),
        ("force", (10, 3.88, 1), None),
        ("direction", (10, 5, 1), 8 / 15),
    ],
)
def test_out_of_reach_each_policy_gives_its_own_answer(backend, policy, tensions, scale):
    result = allocate(PLANAR, [12, 6], (1, 10), f"qp:{backend}", policy=policy)
    assert result.status == Status.NEAREST
    np.testing.assert_allclose(result.tensions, tensions, atol=1e-7)
    if scale:
        assert result.scale == pytest.approx(scale, abs=1e-8)


@each_backend
def test_weights_say_which_component_matters(backend):
    # One cable pulls both components alike: q1 (2 - t)² + q2 t² is least at t = 2 q1 / (q1 + q2).
    result = allocate([[1], [1]], [2, 0], (0, 5), f"qp:{backend}", policy="force", wrench_weights=[3, 1])
    np.testing.assert_allclose(result.tensions, [1.5], atol=1e-7)
    assert result.status == Status.NEAREST


@each_backend
@pytest.mark.parametrize("policy", ["force", "tension"])
def test_of_equally_near_tensions_the_closest_to_the_reference(backend, policy):
    # The first two cables render the same; what is out of reach is the second component.
    W, reference = [[1, 1, 0], [0, 0, 1]], [3, 2, 0]
    result = allocate(W, [4, 9], (0, 5), f"qp:{backend}", reference, policy)
    np.testing.assert_allclose(result.tensions, [2.5, 1.5, 5], atol=1e-6)
    assert result.status == Status.NEAREST


@each_backend
def test_along_the_longest_wrench_the_closest_to_the_reference(backend):
    # s (8, 10) with s = 1/2, of which the two equal cables render 4 N in any way they like.
    W, reference = [[1, 1, 0], [0, 0, 1]], [3, 2, 0]
    result = allocate(W, [8, 10], (0, 5), f"qp:{backend}", reference, "direction")
    np.testing.assert_allclose(result.tensions, [2.5, 1.5, 5], atol=1e-6)
    assert result.scale == pytest.approx(0.5, abs=1e-8)


@each_backend
@each_policy
def test_rank_deficient_rigs_are_ordinary(backend, policy):
    # Two opposite cables on a line: what lies on it is rendered, what lies across is not.
    W, limits = np.array([[1, -1], [1, -1]]), (1, 5)
    along = allocate(W, [2, 2], limits, f"qp:{backend}", policy=policy)
    assert along.status == Status.EXACT
    np.testing.assert_allclose(along.tensions, [3, 1], atol=1e-7)
    across = allocate(W, [2, 0], limits, f"qp:{backend}", policy=policy)
    np.testing.assert_allclose(across.tensions, [1, 1] if policy == "direction" else [2, 1], atol=1e-7)
    assert across.status == Status.NEAREST


@each_backend
@each_policy
def test_cables_without_play_keep_their_tensions(backend, policy):
    some = allocate([[1, 1, 1]], [9], ([2, 0, 0], [2, 5, 5]), f"qp:{backend}", policy=policy)
    assert some.status == Status.EXACT
    assert some.tensions[0] == 2
    np.testing.assert_allclose(some.tensions, [2, 3.5, 3.5], atol=1e-7)
    every = QuadraticProgram(backend).solve(problem([[1, 1]], [9], [2, 3], [2, 3], policy))
    np.testing.assert_array_equal(every.tensions, [[2, 3]])


@each_backend
def test_cables_that_pull_nothing_stay_at_the_reference(backend):
    answer = QuadraticProgram(backend).solve(problem(np.zeros((2, 2)), [1, 7], 1, 5))
    np.testing.assert_array_equal(answer.tensions, [[1, 1]])


@each_backend
@each_policy
def test_random_rigs_agree_with_the_exact_solver(backend, policy):
    rng = np.random.default_rng(11)
    for n, m in [(2, 3), (3, 8), (6, 8)]:
        W = rng.normal(size=(n, m))
        w = np.concatenate([rng.uniform(0.5, 6, (4, m)) @ W.T, 8 * rng.normal(size=(4, n))])
        ours = allocate(W, w, (0.5, 6), f"qp:{backend}", policy=policy)
        exact = allocate(W, w, (0.5, 6), "newton", policy=policy)
        assert Status.UNPROVEN not in ours.status
        np.testing.assert_array_equal(ours.status, exact.status)
        np.testing.assert_allclose(ours.tensions, exact.tensions, rtol=0, atol=1e-5)


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
        return (
            effect(solve(program, solver, **settings)) if len(calls) == 2 else solve(program, solver, **settings)
        )

    monkeypatch.setattr(qpsolvers, "solve_problem", patched)


def test_a_backend_that_throws_is_a_failure_of_that_row_alone(monkeypatch):
    def throw(solution):
        raise qpsolvers.exceptions.SolverError("ran out of steam")

    break_second(monkeypatch, throw)
    answer = QuadraticProgram("daqp").solve(problem([[1, 1]], [[4], [5], [6]], 0, 9))
    assert answer.failures == {1: "daqp: SolverError: ran out of steam"}
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


def test_an_unknown_backend_is_refused_by_name():
    with pytest.raises(UnknownSolver, match=r"'cplex'.*clarabel.*daqp"):
        QuadraticProgram("cplex")


def test_a_missing_backend_names_the_extra(monkeypatch):
    monkeypatch.setattr(qpsolvers, "available_solvers", ["clarabel"])
    assert installed_backends() == ("clarabel",)
    with pytest.raises(MissingDependency, match=r"'daqp'.*pip install \"tensionlab\[solvers\]\""):
        QuadraticProgram("daqp").solve(problem([[1, 1]], [4], 0, 9))


def test_iterations_are_counted_where_the_backend_tells():
    batch = problem(PLANAR, [[1, 1], [12, 6]], 1, 10)
    for backend in ("osqp", "quadprog", "piqp", "proxqp"):
        assert (QuadraticProgram(backend).solve(batch).iterations > 0).all()
