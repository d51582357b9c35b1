"""The readable reference in cvxpy."""

import json
import threading
from pathlib import Path

import cvxpy
import numpy as np
import pytest

from tensionlab import Status, allocate
from tensionlab.errors import UnknownSolver
from tensionlab.solvers import convex
from tensionlab.solvers.convex import ConvexProgram
from tests.helpers.batch import problem

ANSWERS = Path(__file__).parents[1] / "data" / "known_answers.json"
CASES = json.loads(ANSWERS.read_text(encoding="utf-8"))["cases"]
PLANAR = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]])

each_policy = pytest.mark.parametrize("policy", ConvexProgram.policies)


@pytest.mark.parametrize("key", ["zero", "fmin", "mid"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_known_answers(case, key):
    lower, upper = np.array(case["fmin"]), np.array(case["fmax"])
    reference = {"zero": None, "fmin": "lower", "mid": "middle"}[key]
    result = allocate(case["W"], case["wrench_to_produce"], (lower, upper), "cvxpy", reference)
    assert result.status == Status.EXACT
    np.testing.assert_allclose(result.tensions, case[f"min2_from_{key}"], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("policy", "tensions", "scale"),
    [
        ("tension", (10, 575 / 122, 1), None),
        ("force", (10, 3.88, 1), None),
        ("direction", (10, 5, 1), 8 / 15),
    ],
)
def test_out_of_reach_each_policy_gives_its_own_answer(policy, tensions, scale):
    result = allocate(PLANAR, [12, 6], (1, 10), "cvxpy", policy=policy)
    assert result.status == Status.NEAREST
    np.testing.assert_allclose(result.tensions, tensions, atol=1e-7)
    if scale:
        assert result.scale == pytest.approx(scale, abs=1e-8)


def test_weights_say_which_component_matters():
    # One cable pulls both components alike: q1 (2 - t)² + q2 t² is least at t = 2 q1 / (q1 + q2).
    result = allocate([[1], [1]], [2, 0], (0, 5), "cvxpy", policy="force", wrench_weights=[3, 1])
    np.testing.assert_allclose(result.tensions, [1.5], atol=1e-7)


@pytest.mark.parametrize(("policy", "w"), [("force", (4, 9)), ("tension", (4, 9)), ("direction", (8, 10))])
def test_of_equally_good_tensions_the_closest_to_the_reference(policy, w):
    # The first two cables render the same; what is out of reach is the second component.
    result = allocate([[1, 1, 0], [0, 0, 1]], w, (0, 5), "cvxpy", [3, 2, 0], policy)
    np.testing.assert_allclose(result.tensions, [2.5, 1.5, 5], atol=1e-6)
    assert result.status == Status.NEAREST


@each_policy
def test_rank_deficient_rigs_are_ordinary(policy):
    W, limits = np.array([[1, -1], [1, -1]]), (1, 5)
    along = allocate(W, [2, 2], limits, "cvxpy", policy=policy)
    assert along.status == Status.EXACT
    np.testing.assert_allclose(along.tensions, [3, 1], atol=1e-7)
    across = allocate(W, [2, 0], limits, "cvxpy", policy=policy)
    np.testing.assert_allclose(across.tensions, [1, 1] if policy == "direction" else [2, 1], atol=1e-6)
    assert across.status == Status.NEAREST


@each_policy
def test_cables_without_play_keep_their_tensions(policy):
    some = allocate([[1, 1, 1]], [9], ([2, 0, 0], [2, 5, 5]), "cvxpy", policy=policy)
    assert some.status == Status.EXACT
    assert some.tensions[0] == 2
    np.testing.assert_allclose(some.tensions, [2, 3.5, 3.5], atol=1e-7)
    every = ConvexProgram().solve(problem([[1, 1]], [9], [2, 3], [2, 3], policy))
    np.testing.assert_array_equal(every.tensions, [[2, 3]])


@each_policy
def test_random_rigs_agree_with_the_exact_solver(policy):
    rng = np.random.default_rng(11)
    for n, m in [(2, 3), (3, 8), (6, 8)]:
        W = rng.normal(size=(n, m))
        w = np.concatenate([rng.uniform(0.5, 6, (4, m)) @ W.T, 8 * rng.normal(size=(4, n))])
        ours = allocate(W, w, (0.5, 6), "cvxpy", policy=policy)
        exact = allocate(W, w, (0.5, 6), "newton", policy=policy)
        assert Status.UNPROVEN not in ours.status
        np.testing.assert_array_equal(ours.status, exact.status)
        np.testing.assert_allclose(ours.tensions, exact.tensions, rtol=0, atol=1e-5)


def test_programs_are_compiled_once_for_a_shape():
    batch = problem(PLANAR, [[1, 1], [2, 1], [12, 6]], 1, 10)
    ConvexProgram().solve(batch)
    before = convex.compiled_programs.cache_info().misses
    ConvexProgram().solve(batch)
    assert convex.compiled_programs.cache_info().misses == before
    board = convex.CompiledPrograms(2, 3)
    assert all(program.is_dcp(dpp=True) for program in (board.closest, board.least_error, board.longest))


def test_an_answer_does_not_depend_on_the_one_before():
    wrenches = np.array([[1, 1], [12, 6], [-3, 2], [12, 6], [1, 1]])
    together = ConvexProgram().solve(problem(PLANAR, wrenches, 1, 10)).tensions
    for w, t in zip(wrenches, together, strict=True):
        np.testing.assert_array_equal(ConvexProgram().solve(problem(PLANAR, w, 1, 10)).tensions[0], t)


@pytest.mark.filterwarnings("ignore")  # warning filters are one for all threads
def test_threads_do_not_share_their_parameters():
    wrenches = np.random.default_rng(5).normal(size=(2, 20, 2)) * 3
    alone = [ConvexProgram().solve(problem(PLANAR, w, 1, 10)).tensions for w in wrenches]
    found = [np.zeros(0), np.zeros(0)]

    def run(i):
        found[i] = ConvexProgram().solve(problem(PLANAR, wrenches[i], 1, 10)).tensions

    threads = [threading.Thread(target=run, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal(found, alone)


def test_a_backend_that_throws_is_a_failure_of_that_row_alone(monkeypatch):
    solve, calls = cvxpy.Problem.solve, []

    def patched(program, **settings):
        calls.append(program)
        if 2 <= len(calls) <= 5:  # two programs, each with tight settings and with the backend's own
            raise cvxpy.error.SolverError("ran out of steam")
        return solve(program, **settings)

    monkeypatch.setattr(cvxpy.Problem, "solve", patched)
    answer = ConvexProgram().solve(problem([[1, 1]], [[4], [5], [6]], 0, 9))
    assert answer.failures == {1: "CLARABEL: SolverError: ran out of steam"}
    assert np.isnan(answer.tensions[1]).all()
    np.testing.assert_allclose(answer.tensions[[0, 2]], [[2, 2], [3, 3]], atol=1e-7)


def test_an_unknown_backend_is_refused_by_name():
    with pytest.raises(UnknownSolver, match=r"'MOSEK'.*CLARABEL"):
        ConvexProgram("MOSEK")
