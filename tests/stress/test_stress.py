"""Millions of random and awkward problems for the exact solver, each answer checked without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from tensionlab.allocation import Allocation, allocate
from tensionlab.benchmark.optimum import at_limits, distance_bound, largest_limit
from tensionlab.benchmark.rigs import near_singular, structures
from tensionlab.solvers.base import POLICIES, TOLERANCE, Answer, Policy, Problem, Status
from tensionlab.solvers.programs import times
from tensionlab.support.arrays import Floats, Integers
from tensionlab.verification import verify
from tests.stress import cases

SHAPES = (
    *((1, 1), (1, 2), (2, 3), (2, 8), (3, 3), (3, 4), (3, 5), (3, 8), (3, 12), (3, 32)),
    *((4, 6), (5, 7), (6, 6), (6, 7), (6, 8), (6, 12), (6, 32)),
)
RENDERED = 1e-12  # error of a feasible wrench, as a share of the wrench that the cables can render
WRONG = 1e-6  # distance of wrong tensions from the optimum, in N, or as a share of the largest limit


@dataclass(frozen=True)
class Draw:
    """Problems of one shape, their wrenches not yet chosen."""

    structure: Floats
    lower: Floats
    upper: Floats
    inside: Floats  # tensions inside the limits

    def wrench(self, stretch: Floats | float = 1.0) -> Floats:
        """Return the wrenches that the tensions inside the limits render, stretched."""
        rendered = times(self.structure, self.inside)
        return np.asarray(rendered * np.broadcast_to(stretch, len(rendered))[:, None])


def _ordinary(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    structure = structures(rng, 3 if n <= 3 else 6, m, count)[:, :n]
    lower, upper = np.full((count, m), 0.5), np.full((count, m), 6.0)
    return Draw(structure, lower, upper, rng.uniform(lower, upper))


def _edge(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Wrenches that take nearly all cables to their limits."""
    draw = _ordinary(rng, n, m, count)
    kind = rng.random((count, m))
    inside = np.where(kind < 0.4, draw.lower, np.where(kind < 0.8, draw.upper, draw.inside))
    return Draw(draw.structure, draw.lower, draw.upper, inside)


def _parallel(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Cables along one another, opposed, or without play; others of very different strength."""
    draw = _ordinary(rng, n, m, count)
    structure, lower, upper = draw.structure.copy(), draw.lower.copy(), draw.upper.copy()
    structure[::2, :, -1] = structure[::2, :, 0]
    structure[::3, :, -1] = -structure[::3, :, 0]
    upper[::4, m // 2] = lower[::4, m // 2]
    lower[::5, 0], upper[::5, 0] = 0.0, 186.0
    return Draw(structure, lower, upper, rng.uniform(lower, upper))


def _nearly_parallel(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Pairs of cables whose directions differ by 1e-5."""
    draw = _ordinary(rng, n, m, count)
    structure = draw.structure.copy()
    pairs = m // 2
    structure[:, :, :pairs] = structure[:, :, m - pairs :] + 1e-5 * rng.normal(size=(count, n, pairs))
    return Draw(structure, draw.lower, draw.upper, draw.inside)


def _integer(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Small whole numbers: many answers on corners and edges at once, many matrices that lack a rank."""
    structure = rng.integers(-2, 3, (count, n, m)).astype(float)
    lower, upper = np.full((count, m), 1.0), np.full((count, m), 4.0)
    return Draw(structure, lower, upper, rng.integers(1, 5, (count, m)).astype(float))


def _singular(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Structure matrices that lack a rank."""
    draw = _ordinary(rng, n, m, count)
    structure = draw.structure.copy()
    structure[:, -1] = structure[:, 0] * rng.uniform(-1.0, 1.0, (count, 1))
    return Draw(structure, draw.lower, draw.upper, draw.inside)


def _near_singular(rng: np.random.Generator, n: int, m: int, count: int) -> Draw:
    """Structure matrices with a condition of 100 to 10,000."""
    condition = 10.0 ** rng.uniform(2.0, 4.0, count)
    if n in (3, 6):
        structure = near_singular(rng, n, m, condition)
    else:
        structure = _ordinary(rng, n, m, count).structure / np.linspace(1.0, condition, n)[:, :, None].swapaxes(
            0, 1
        )
    lower, upper = np.full((count, m), 0.5), np.full((count, m), 6.0)
    return Draw(structure, lower, upper, rng.uniform(lower, upper))


# How the rigs of a kind are drawn, and by how much a feasible wrench is stretched.
KINDS: dict[str, tuple[Callable[[np.random.Generator, int, int, int], Draw], Callable[..., Floats | float]]] = {
    "feasible": (_ordinary, lambda rng, count: 1.0),
    "at the edge": (_edge, lambda rng, count: 1.0),
    "barely infeasible": (_edge, lambda rng, count: 1.0 + 10.0 ** rng.uniform(-9.0, -2.0, count)),
    "infeasible": (_ordinary, lambda rng, count: rng.uniform(1.0, 4.0, count)),
    "far from feasible": (_ordinary, lambda rng, count: 10.0 ** rng.uniform(1.0, 6.0, count)),
    "parallel, fixed, strong": (_parallel, lambda rng, count: rng.uniform(0.5, 2.0, count)),
    "nearly parallel": (_nearly_parallel, lambda rng, count: rng.uniform(0.5, 2.0, count)),
    "whole numbers": (_integer, lambda rng, count: rng.integers(1, 3, count).astype(float)),
    "singular": (_singular, lambda rng, count: rng.uniform(0.5, 2.0, count)),
    "nearly singular": (_near_singular, lambda rng, count: rng.uniform(0.5, 2.0, count)),
}


def _problem(rng: np.random.Generator, draw: Draw, wrench: Floats, policy: Policy) -> Problem:
    references = (
        np.zeros_like(draw.lower),
        draw.lower,
        (draw.lower + draw.upper) / 2,
        rng.uniform(-2.0, 8.0, draw.lower.shape),
    )
    reference = references[rng.integers(4)]
    return Problem(draw.structure, wrench, draw.lower, draw.upper, reference, np.ones(wrench.shape[1]), policy)


def _solve(problem: Problem) -> Allocation:
    lower, upper = problem.lower, problem.upper
    if (lower == lower[0]).all() and (upper == upper[0]).all():
        lower, upper = lower[0], upper[0]  # one for all rows takes another path
    limits, policy = (lower, upper), problem.policy
    return allocate(problem.structure, problem.wrench, limits, reference=problem.reference, policy=policy)


def _check(problem: Problem, feasible: NDArray[np.bool_]) -> tuple[NDArray[np.int8], Floats, Integers]:
    """Return statuses, distances to the promised tensions, and iterations. feasible: by construction, (B,)."""
    found = _solve(problem)
    exact = found.status == Status.EXACT
    distance = distance_bound(problem, found.tensions, found.separation)
    # EXACT may be barely infeasible: then it promises the wrench within tolerance, and the tensions that are best
    # for the wrench they render. A feasible wrench is rendered to rounding, and the error would not change the
    # tensions, however near W is to singular.
    missing = problem.wrench - found.wrench
    error = np.linalg.norm(missing, axis=1)
    limit = largest_limit(problem)
    rendered = error <= RENDERED * np.linalg.norm(np.abs(problem.structure).sum(axis=2), axis=1) * limit
    free = ~np.logical_or(*at_limits(problem, found.tensions))
    change = times(np.asarray(np.linalg.pinv(problem.structure * free[:, None, :])), missing)
    better = found.tensions + change
    left = np.linalg.norm(problem.wrench - times(problem.structure, better), axis=1)
    room = ((problem.lower <= better) & (better <= problem.upper)).all(axis=1)
    room &= left <= 1e-3 * error
    distance += np.where(exact & room & rendered, np.linalg.norm(change, axis=1), 0.0)
    desired = np.maximum(1.0, np.linalg.norm(problem.wrench, axis=1))
    missed = (exact & (error > TOLERANCE * desired)) | (feasible & ~(exact & rendered))
    return found.status, np.where(missed, np.inf, distance / np.maximum(1.0, limit)), found.iterations


def _results(kind: str, policy: Policy) -> tuple[NDArray[np.int8], Floats, Integers]:
    """Return statuses, distances to the promised tensions, and iterations, for all shapes.

    An answer is right if it is proved EXACT or NEAREST, keeps what `tensionlab.Allocation` promises of the status,
    and multipliers show that no other tensions that render the same are closer to the reference
    (`tensionlab.benchmark.optimum`). References are zero, the lower limits, the middle, or random.
    """
    draw, stretch = KINDS[kind]
    found = []
    for n, m in SHAPES:
        rng = np.random.default_rng([5, list(KINDS).index(kind), POLICIES.index(policy), n, m])
        drawn = draw(rng, n, m, cases(40))
        stretched = np.broadcast_to(stretch(rng, cases(40)), cases(40))
        found.append(_check(_problem(rng, drawn, drawn.wrench(stretched), policy), stretched == 1.0))
    status, distance, iterations = (np.concatenate(each) for each in zip(*found, strict=True))
    return status, distance, iterations


@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_exact_solver_is_never_wrong_and_never_without_proof(kind, policy):
    status, distance, iterations = _results(kind, policy)
    assert (distance <= WRONG).all()
    hard = (kind, policy) == (
        "nearly parallel",
        "direction",
    )  # not all of these are proved, and their status says so
    assert iterations.max() < 400 or hard
    assert (status >= Status.UNPROVEN).mean() <= (0.002 if hard else 0.0)
    exact = (status == Status.EXACT).mean()
    assert kind != "feasible" or exact == 1.0
    assert kind != "far from feasible" or exact < 0.01
    assert kind != "singular" or 0.0 < exact < 1.0


def test_an_answer_that_is_off_by_little_is_found_out(monkeypatch: pytest.MonkeyPatch):
    solve = _solve

    def spoilt(problem):
        # Along the null space: the wrench is the same, the tensions are not the closest.
        found = solve(problem)
        null = np.linalg.svd(problem.structure)[2][:, -1]
        tensions = np.clip(found.tensions + 1e-5 * null, problem.lower, problem.upper)
        return verify(problem, Answer(tensions, found.iterations, found.separation.copy()))

    monkeypatch.setitem(globals(), "_solve", spoilt)
    monkeypatch.setitem(globals(), "SHAPES", ((3, 8),))
    assert (_results("feasible", "force")[1] > WRONG).mean() > 0.5
