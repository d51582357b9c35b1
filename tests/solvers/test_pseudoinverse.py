"""Tensions from one pseudo-inverse: Pott's closed form and the plain least norm."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensionlab.solvers.base import RANK_TOLERANCE
from tensionlab.solvers.closed_form import Pseudoinverse
from tensionlab.solvers.programs import times
from tests.helpers.batch import problem, random_problem

ANSWERS = Path(__file__).parents[1] / "data" / "known_answers.json"
CASES = json.loads(ANSWERS.read_text(encoding="utf-8"))["cases"]


@pytest.mark.parametrize("start", ["reference", "middle"])
@pytest.mark.parametrize("m", [1, 3, 8, 9])
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_agrees_with_its_statement_in_numpy(n, m, start):
    given = random_problem(n, m)
    t = given.reference if start == "reference" else (given.lower + given.upper) / 2
    inverse = np.linalg.pinv(given.structure, rcond=RANK_TOLERANCE)
    stated = np.clip(t + times(inverse, given.wrench - times(given.structure, t)), given.lower, given.upper)
    answer = Pseudoinverse(start).solve(given)
    np.testing.assert_allclose(answer.tensions, stated, rtol=0, atol=1e-10)
    assert not answer.iterations.any()
    assert f"change from the {start}" in Pseudoinverse(start).objective


def inverse_of(W):
    """The pseudo-inverse by which the solver goes: what it answers to unit wrenches."""
    return Pseudoinverse().solve(problem(W, np.eye(len(W)), -1e12, 1e12)).tensions.T


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_its_matrix_fulfils_the_four_conditions_of_penrose(rank):
    rng = np.random.default_rng(rank)
    for W in rng.normal(size=(20, 3, rank)) @ rng.normal(size=(20, rank, 5)):
        inverse = inverse_of(W)
        np.testing.assert_allclose(W @ inverse @ W, W, atol=1e-12)
        np.testing.assert_allclose(inverse @ W @ inverse, inverse, atol=1e-9)
        for product in (W @ inverse, inverse @ W):
            np.testing.assert_allclose(product, product.T, atol=1e-9)


@pytest.mark.parametrize(("share", "counts"), [(0.1 * RANK_TOLERANCE, False), (10 * RANK_TOLERANCE, True)])
def test_what_counts_as_zero(share, counts):
    assert (inverse_of(np.diag([2.0, 2.0 * share]))[1, 1] > 0) == counts


@pytest.mark.parametrize("digits", [2, 4, 6, 7.5])
@pytest.mark.parametrize(("n", "m"), [(3, 3), (3, 8), (6, 8)])
def test_is_as_accurate_as_a_singular_value_decomposition(n, m, digits):
    # Condition number 10^digits. What is rendered must not depend on it, and the tensions no more than NumPy's.
    rng = np.random.default_rng(n + m)
    left, right = (np.linalg.qr(rng.normal(size=(200, size, size)))[0] for size in (n, m))
    W = (left * np.logspace(0, -digits, n)) @ right[:, :n]
    least = times(np.swapaxes(right[:, :n], 1, 2), rng.uniform(-1.0, 1.0, (200, n)))
    given = problem(W, times(W, least), -1e3, 1e3)
    t = Pseudoinverse().solve(given).tensions
    assert np.abs(times(W, t) - given.wrench).max() < 1e-14
    theirs = times(np.linalg.pinv(W, rcond=RANK_TOLERANCE), given.wrench)
    assert np.abs(t - least).max() < max(1e-14, 2 * np.abs(theirs - least).max())


@pytest.mark.parametrize(("start", "key"), [("middle", "closed_form_mid"), ("reference", "pinv_min_norm")])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_known_answers_inside_the_limits(case, start, key):
    lower, upper = np.array(case["fmin"]), np.array(case["fmax"])
    answer = Pseudoinverse(start).solve(problem(case["W"], case["wrench_to_produce"], lower, upper))
    np.testing.assert_allclose(answer.tensions[0], np.clip(case[key], lower, upper), rtol=1e-10, atol=1e-10)


def test_arrays_that_are_strided_within_a_problem_are_refused():
    given = problem([[1, -1]], [[1], [2]], 0, 4)
    for field in ("structure", "lower"):
        strided = np.repeat(getattr(given, field), 2, axis=-1)[..., ::2]
        with pytest.raises(ValueError, match="only the first axis"):
            Pseudoinverse().solve(replace(given, **{field: strided}))
