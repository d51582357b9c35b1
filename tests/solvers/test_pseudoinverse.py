"""Tensions from one pseudo-inverse: Pott's closed form and the plain least norm."""

import json
from pathlib import Path

import numpy as np
import pytest

from tensionlab.solvers.contract import Problem
from tensionlab.solvers.pseudoinverse import Pseudoinverse

ANSWERS = Path(__file__).parents[1] / "data" / "known_answers.json"
CASES = json.loads(ANSWERS.read_text(encoding="utf-8"))["cases"]


def problem(W, w, lower, upper, reference=None):
    """A batch of one."""
    W, w, lower, upper = (np.array([a], dtype=float) for a in (W, w, lower, upper))
    reference = np.zeros_like(lower) if reference is None else np.array([reference], dtype=float)
    return Problem(W, w, lower, upper, reference, np.ones(len(W[0])), None)


@pytest.mark.parametrize(("start", "key"), [("middle", "closed_form_mid"), ("reference", "pinv_min_norm")])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_known_answers_inside_the_limits(case, start, key):
    lower, upper = np.array(case["fmin"]), np.array(case["fmax"])
    answer = Pseudoinverse(start).solve(problem(case["W"], case["wrench_to_produce"], lower, upper))
    np.testing.assert_allclose(answer.tensions[0], np.clip(case[key], lower, upper), rtol=1e-10, atol=1e-10)


def test_keeps_to_the_reference_where_the_wrench_leaves_a_choice():
    answer = Pseudoinverse().solve(problem([[1, 1]], [5], [0, 0], [9, 9], reference=[3, 1]))
    np.testing.assert_allclose(answer.tensions, [[3.5, 1.5]])


def test_ignores_the_part_of_a_wrench_that_no_cable_can_render():
    answer = Pseudoinverse("middle").solve(problem([[1, -1], [0, 0]], [1, 7], [0, 0], [4, 4]))
    np.testing.assert_allclose(answer.tensions, [[2.5, 1.5]])


def test_a_cable_without_play_keeps_its_tension():
    answer = Pseudoinverse("middle").solve(problem([[1, -1]], [1], [2, 0], [2, 4]))
    assert answer.tensions[0, 0] == 2.0


def test_an_unknown_start_is_refused_by_name():
    with pytest.raises(ValueError, match=r"start='lower'.*reference.*middle"):
        Pseudoinverse("lower")
