"""Tensions of the exact solver on hostile problems, each answer checked without it."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.allocation import allocate
from tensionlab.benchmark.optimum import at_limits, distance_bound, largest_limit
from tensionlab.solvers.base import POLICIES, TOLERANCE, Answer, Status
from tensionlab.solvers.programs import times
from tensionlab.verification import verify
from tests.stress import cases
from tests.stress.hostile_problems import hostile_problems

SHAPES = ((1, 1), (1, 2), (2, 8), (3, 3), (3, 4), (3, 5), (3, 8), (3, 32), (4, 6), (5, 7), (6, 7), (6, 8), (6, 32))
RENDERED = 1e-12  # error of a feasible wrench, as a share of the wrench that the cables can render
WRONG = 1e-6  # distance of wrong tensions from the optimum, in N, or as a share of the largest limit


def draw(n, m, policy, count):
    """Draw problems, and which of them are certainly feasible."""
    rng = np.random.default_rng([5, n, m, POLICIES.index(policy)])
    problem, inside, kinds = hostile_problems(rng, n, m, count, policy)
    chosen = kinds != "turned"  # W t is rounded there: the nearest tensions depend on the last digit
    problem, inside, kinds = problem.take(np.flatnonzero(chosen)), inside[chosen], kinds[chosen]
    if rng.random() < 0.5:
        share = rng.uniform(-0.5, 1.5, problem.lower.shape)
        problem = replace(problem, reference=problem.lower + share * (problem.upper - problem.lower))
    rendered = (times(problem.structure, inside) == problem.wrench).all(axis=1)
    return problem, rendered & (kinds != "scaled")  # whose wrenches may be rounded by more than the tolerance


def distances(problem, found):
    """Return the distance of each answer from the tensions that its status promises, as a share of the limits.

    EXACT may be barely infeasible: then it promises the wrench within tolerance, and the best tensions for the
    wrench they render. Where the error is rounding, removing it must not change the tensions.
    """
    exact = found.status == Status.EXACT
    missing = problem.wrench - found.wrench
    error, limit = np.linalg.norm(missing, axis=1), largest_limit(problem)
    rendered = error <= RENDERED * np.linalg.norm(np.abs(problem.structure).sum(axis=2), axis=1) * limit
    free = ~np.logical_or(*at_limits(problem, found.tensions))
    change = times(np.linalg.pinv(problem.structure * free[:, None, :]), missing)
    better = found.tensions + change
    room = ((problem.lower <= better) & (better <= problem.upper)).all(axis=1)
    room &= np.linalg.norm(problem.wrench - times(problem.structure, better), axis=1) <= 1e-3 * error
    distance = distance_bound(problem, found.tensions, found.separation)
    distance += np.where(exact & room & rendered, np.linalg.norm(change, axis=1), 0.0)
    desired = np.maximum(1.0, np.linalg.norm(problem.wrench, axis=1))
    return np.where(exact & (error > TOLERANCE * desired), np.inf, distance / np.maximum(1.0, limit))


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_tensions_are_those_that_their_status_promises(shape, policy):
    problem, feasible = draw(*shape, policy, cases(60))
    lower, upper = problem.lower, problem.upper
    if (lower == lower[0]).all() and (upper == upper[0]).all():
        lower, upper = lower[0], upper[0]  # one for all rows takes another path
    found = allocate(
        problem.structure, problem.wrench, (lower, upper), reference=problem.reference, policy=problem.policy
    )
    proved = found.status <= Status.NEAREST
    rare = (0.03 if policy == "direction" else 0.002) * len(feasible)  # which are a matter of rounding
    assert (~proved).sum() <= 1 + rare
    assert (distances(problem, found)[proved] > WRONG).sum() <= 1 + 0.1 * rare
    assert (found.status[feasible] == Status.EXACT).all()
    assert feasible.any()

    # Along the null space: the wrench is the same, the tensions are not the closest.
    null = np.linalg.svd(problem.structure)[2][:, -1]
    tensions = np.clip(found.tensions + 1e-4 * null, problem.lower, problem.upper)
    spoilt = verify(problem, Answer(tensions, found.iterations, found.separation.copy()))
    assert shape[0] >= shape[1] or (distances(problem, spoilt) > WRONG).sum() > 5
