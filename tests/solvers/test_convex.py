"""The readable reference in cvxpy."""

import threading

import cvxpy
import numpy as np
import pytest

from tensionlab.solvers import convex
from tensionlab.solvers.convex import ConvexProgram
from tests.helpers.batch import problem

PLANAR = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]])

each_policy = pytest.mark.parametrize("policy", ConvexProgram.policies)


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
