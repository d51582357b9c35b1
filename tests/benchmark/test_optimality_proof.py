"""The bound on the distance to the optimum, on answers known by hand and on those of the exact solver."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.optimality_proof import _bound, distance_bound
from tests.support.batch import problem, random_problem


def test_multipliers_prove_an_answer_known_by_hand_and_no_other():
    # The sum of two cables is 4 N: 2 N each. (3, 1) renders the same and is √2 away.
    two = problem([[1, 1]], [[4], [4]], [0, 0], [5, 5])
    bound = distance_bound(two, np.array([[2.0, 2.0], [3.0, 1.0]]))
    assert bound[0] < 1e-12
    assert bound[1] >= np.sqrt(2)


def test_the_bound_by_hand():
    one, t = problem([[1, 2]], [4], [0, 0], [5, 5]), np.array([[4.0, 0.0]])
    # The free cable gives y = 4; then W'y = (4, 8), and only a reference of -8 would hold the other at 0.
    assert _bound(one, t, np.array([[4.0]]))[0] == pytest.approx(8.0)
    # The best is (0.8, 1.6), with y = 0.8: the bound is then the distance itself.
    assert distance_bound(one, t)[0] == pytest.approx(np.hypot(3.2, 1.6))


def test_multipliers_are_found_where_few_cables_are_off_their_limits():
    # All at a limit, opposed, parallel, fixed, pulling nothing: every kind has multipliers.
    W = np.array([[1.0, -1.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    t = np.array([[5.0, 1.0, 5.0, 1.0]])
    one = problem(W, W @ t[0], [1, 1, 5, 1], [5, 5, 5, 5])
    assert distance_bound(one, t)[0] < 1e-9


@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 8), (6, 9)])
def test_the_exact_solver_is_proved_for_any_reference_and_what_is_moved_from_it_is_not(n, m):
    drawn = random_problem(n, m, 200)
    found = tl.allocate(drawn.structure, drawn.wrench, (drawn.lower, drawn.upper), reference=drawn.reference)
    bound = distance_bound(drawn, found.tensions, found.separation)
    assert (bound < 1e-6).all()
    # Without the separating directions it takes longer, and proves the same.
    assert (distance_bound(drawn, found.tensions) < 1e-6).all()
    other = replace(drawn, reference=drawn.reference + np.linspace(0.5, 3.0, m))
    moved = tl.allocate(drawn.structure, found.wrench, (drawn.lower, drawn.upper), reference=other.reference)
    distance = np.linalg.norm(moved.tensions - found.tensions, axis=1)
    assert (distance_bound(other, found.tensions) >= distance - 1e-6).all()
    assert distance.max() > 0.1
