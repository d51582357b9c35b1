"""What every solver must keep, whatever it minimises: one suite over the whole table and all policies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import tensionlab as tl
from tensionlab.solvers import find_plugins, make
from tensionlab.solvers.base import RANK_TOLERANCE, TOLERANCE, refusal
from tensionlab.solvers.programs import whitener
from tensionlab.solvers.quadratic import installed_backends
from tests.helpers.examples import many
from tests.helpers.oracle import Truth, UnsureError, solve, support
from tests.helpers.problems import Case, batches, one, random_cases

# Families that minimise the distance to the reference, and find an answer wherever there is one.
CLOSEST = ("newton", "dykstra", "qp", "cvxpy")
# Share of ordinary problems that a backend may leave at UNPROVEN. None may give a wrong verdict.
MAY_GIVE_UP = {"qp:osqp": 0.05, "qp:quadprog": 0.05, "qp:highs": 0.05}
# Families that say FAILED where a rank-deficient structure matrix leaves more redundancy than this.
LARGEST_REDUNDANCY = {"polygon": 2}
# Drawn examples of a test for slow families; many(60) for the other built-in ones, many(15) for plugins.
EXAMPLES = {"qp": many(15, least=3), "cvxpy": many(10, least=2)}

VARIANTS = [
    *(name for name in tl.SOLVERS if name not in ("qp", "pseudoinverse", "polygon")),
    *(f"qp:{backend}" for backend in installed_backends()),
    "pseudoinverse:reference",
    "pseudoinverse:middle",
    "polygon:centroid",
    "polygon:1-norm",
    "polygon:2-norm",
    *(name for name, found in find_plugins().items() if isinstance(found, type)),
]
PAIRS = [(name, policy) for name in VARIANTS for policy in make(name).policies or (None,)]
every_solver = pytest.mark.parametrize("name", VARIANTS)
every_policy = pytest.mark.parametrize(("name", "policy"), PAIRS)
drawn_shapes = st.tuples(st.sampled_from([2, 3, 6]), st.integers(1, 9), st.integers(0, 2**32 - 1))


def family(name: str) -> str:
    return name.partition(":")[0]


def examples(name: str) -> int:
    return EXAMPLES.get(family(name), many(60 if family(name) in tl.SOLVERS else 15))


def run(case: Case, name: str, policy: Any) -> tl.Allocation:
    return tl.allocate(
        case.structure, case.wrench, case.limits, name, case.reference, policy, wrench_weights=case.weights
    )


def same(first: tl.Allocation, second: tl.Allocation, tensions: NDArray[np.float64], scale: float = 1.0) -> None:
    """Equal statuses, and tensions equal to ``tensions`` times scale; roughly so where a solver gave up."""
    np.testing.assert_array_equal(first.status, second.status)
    difference = np.abs(first.tensions - scale * tensions).max(axis=-1, initial=0) / scale
    assert (difference <= np.where(first.status == tl.Status.UNPROVEN, 1e-4, 2e-6)).all(), difference


# What is known of each problem: the same ones are drawn for every solver.
TRUTHS: dict[tuple[bytes, ...], Truth | None] = {}


def judged(case: Case, policy: str) -> Truth | None:
    fields = (case.structure, case.wrench, case.lower, case.upper, case.reference, case.weights)
    key = (policy.encode(), *(field.tobytes() for field in fields))
    if key not in TRUTHS:
        try:
            TRUTHS[key] = solve(case, policy)
        except UnsureError:
            TRUTHS[key] = None
    return TRUTHS[key]


def check(case: Case, found: tl.Allocation, i: int, policy: Any) -> None:
    """Hold one answer of a batch against what can be measured here."""
    t, status = found.tensions[i], found.status[i]
    assert status in (tl.Status.EXACT, tl.Status.NEAREST, tl.Status.UNPROVEN)
    assert np.all(t >= case.lower)
    assert np.all(t <= case.upper)
    np.testing.assert_allclose(found.wrench[i], case.structure @ t, rtol=0, atol=1e-11)
    error = case.wrench - case.structure @ t
    residual = np.sqrt(np.sum(case.weights * error**2))
    tolerance = TOLERANCE * max(1.0, np.sqrt(np.sum(case.weights * case.wrench**2)))
    assert found.residual[i] == pytest.approx(residual, abs=1e-11)
    assert (status == tl.Status.EXACT) == (found.residual[i] <= tolerance)

    d = found.separation[i]
    if status == tl.Status.NEAREST:
        assert policy is not None
        assert d @ case.wrench > support(case.structure, d, case.lower, case.upper)
        truth = judged(case, policy)
        if truth is not None:
            assert not truth.reachable
            check_nearest(case, error, found.scale[i], truth, policy)
    else:
        assert not d.any()
        np.testing.assert_equal(found.scale[i], 1.0 if status == tl.Status.EXACT else np.nan)
    force = judged(case, "force")
    if status == tl.Status.EXACT and force is not None:
        assert force.error <= tolerance


def check_all(case: Case, found: tl.Allocation, name: str, policy: Any) -> None:
    """Hold every answer of a batch against what can be measured here; failures against what may fail."""
    most = LARGEST_REDUNDANCY.get(family(name), case.structure.shape[-1])
    for i in range(len(case.wrench)):
        alone = one(case, i)
        loose = alone.structure[:, alone.lower < alone.upper]
        redundancy = loose.shape[1] - np.linalg.matrix_rank(loose, rtol=RANK_TOLERANCE)
        if redundancy > most:
            assert found.status[i] == tl.Status.FAILED
            assert str(redundancy) in found.failures[i]
        else:
            assert i not in found.failures
            check(alone, found, i, policy)


def serves(name: str, n: int, m: int) -> bool:
    return refusal(make(name), n, m) is None


def check_nearest(case: Case, error: NDArray[np.float64], scale: float, truth: Truth, policy: str) -> None:
    """Is the error of a NEAREST answer, in the metric of its policy, as small as the judge's."""
    size = TOLERANCE * max(1.0, np.sqrt(np.sum(case.weights * case.wrench**2)))
    if policy == "direction" and not np.isnan(truth.scale):
        assert scale == pytest.approx(truth.scale, abs=size)
        off = case.wrench * (1 - scale) - error
        assert np.sqrt(np.sum(case.weights * off**2)) <= 2 * size
        return
    assert np.isnan(scale)
    if policy == "tension":
        root = whitener(case.structure)
        size = TOLERANCE * max(1.0, float(np.linalg.norm(root @ case.wrench)))
        assert np.linalg.norm(root @ error) <= truth.error + 1.01 * size
    else:
        assert np.sqrt(np.sum(case.weights * error**2)) <= truth.error + 1.01 * size


@every_policy
def test_answers_are_what_they_claim(name: str, policy: Any) -> None:
    @settings(max_examples=examples(name))
    @given(case=batches())
    def holds(case: Case) -> None:
        assume(serves(name, *case.structure.shape[1:]))
        check_all(case, run(case, name, policy), name, policy)

    holds()


@pytest.mark.parametrize(("name", "policy"), [p for p in PAIRS if family(p[0]) in CLOSEST])
def test_reachable_is_exact_and_unreachable_nearest(name: str, policy: Any) -> None:
    count, given_up = 2 * examples(name), 0
    shapes = ((2, 4), (3, 4), (3, 8), (6, 8))
    for n, m in shapes:
        batch = random_cases(17 * n + m, n, m, count)
        batch = replace(batch, weights=np.linspace(0.3, 3.0, n) if m == 4 else np.ones(n))
        found = run(batch, name, policy)
        for i in range(count):
            truth = judged(one(batch, i), policy)
            if name in MAY_GIVE_UP and found.status[i] == tl.Status.UNPROVEN:
                given_up += 1
            elif truth is not None:
                expected = tl.Status.EXACT if truth.reachable else tl.Status.NEAREST
                assert found.status[i] == expected, (n, m, i)
                np.testing.assert_allclose(found.tensions[i], truth.tensions, rtol=0, atol=1e-5)
    assert given_up <= MAY_GIVE_UP.get(name, 0) * count * len(shapes)


@every_policy
def test_a_hair_out_of_reach_is_not_exact(name: str, policy: Any) -> None:
    # The wrench furthest along d, and 1e-4 N beyond it: the published tolerance is 1e-6 times |w|.
    rng = np.random.default_rng(2)
    W, d = random_cases(2, 3, 5, 1).structure[0], rng.normal(size=(10, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    edge = np.where(d @ W > 0, 6.0, 0.5) @ W.T
    assert np.linalg.norm(edge, axis=1).max() < 30
    beyond = tl.allocate(W, edge + 1e-4 * d, (0.5, 6.0), name, "lower", policy)
    assert np.all(beyond.status != tl.Status.EXACT)
    if name == "newton":
        assert np.all(beyond.status == tl.Status.NEAREST)
        assert np.all(tl.allocate(W, edge, (0.5, 6.0), name, "lower", policy).status == tl.Status.EXACT)


@every_policy
def test_batch_equals_loop(name: str, policy: Any) -> None:
    @settings(max_examples=examples(name))
    @given(drawn=drawn_shapes)
    def holds(drawn: tuple[int, int, int]) -> None:
        n, m, seed = drawn
        assume(serves(name, n, m))
        batch = random_cases(seed, n, m, 2)
        together = run(batch, name, policy)
        for i in range(2):
            alone = run(one(batch, i), name, policy)
            assert alone.status == together.status[i]
            np.testing.assert_allclose(together.tensions[i], alone.tensions, rtol=0, atol=1e-9)
            np.testing.assert_allclose(together.scale[i], alone.scale, rtol=0, atol=1e-9)

    holds()


@every_policy
def test_permuting_cables_permutes_the_answer(name: str, policy: Any) -> None:
    @settings(max_examples=examples(name))
    @given(drawn=drawn_shapes, data=st.data())
    def holds(drawn: tuple[int, int, int], data: st.DataObject) -> None:
        n, m, seed = drawn
        assume(serves(name, n, m))
        batch = random_cases(seed, n, m, 2)
        order = data.draw(st.permutations(range(m)))
        turned = Case(
            batch.structure[:, :, order],
            batch.wrench,
            batch.lower[:, order],
            batch.upper[:, order],
            batch.reference[:, order],
            batch.weights,
        )
        first, second = run(batch, name, policy), run(turned, name, policy)
        same(second, first, first.tensions[:, order])

    holds()


@every_policy
def test_a_stronger_rig_gives_stronger_answers(name: str, policy: Any) -> None:
    @settings(max_examples=examples(name))
    @given(drawn=drawn_shapes)
    def holds(drawn: tuple[int, int, int]) -> None:
        n, m, seed = drawn
        assume(serves(name, n, m))
        c = random_cases(seed, n, m, 2)
        strong = replace(
            c,
            wrench=1000 * c.wrench,
            lower=1000 * c.lower,
            upper=1000 * c.upper,
            reference=1000 * c.reference,
        )
        first, second = run(c, name, policy), run(strong, name, policy)
        same(second, first, first.tensions, 1000.0)

    holds()


@every_policy
def test_leading_axes_broadcast(name: str, policy: Any) -> None:
    structures, wrenches = random_cases(5, 3, 5, 2), random_cases(6, 3, 5, 3)
    lower, upper = structures.lower[0], structures.upper[0]
    found = tl.allocate(structures.structure[:, None], wrenches.wrench, (lower, upper), name, "middle", policy)
    assert found.tensions.shape == (2, 3, 5)
    assert found.wrench.shape == found.separation.shape == (2, 3, 3)
    for field in (found.residual, found.status, found.scale, found.iterations):
        assert field.shape == (2, 3)
    for p in range(2):
        for k in range(3):
            alone = tl.allocate(
                structures.structure[p], wrenches.wrench[k], (lower, upper), name, "middle", policy
            )
            np.testing.assert_allclose(found.tensions[p, k], alone.tensions, rtol=0, atol=1e-9)
            assert found.status[p, k] == alone.status


@every_policy
def test_an_empty_batch_is_fine(name: str, policy: Any) -> None:
    found = tl.allocate(np.zeros((0, 3, 5)), np.zeros(3), (0.0, 1.0), name, None, policy)
    assert found.tensions.shape == (0, 5)
    assert found.wrench.shape == (0, 3)
    assert found.status.shape == (0,)
    assert found.raise_for_status() is found


RANK_DEFICIENT = {
    "zero": np.zeros((3, 4)),
    "no pull": np.zeros((2, 1)),
    "one cable": np.array([[0.6], [0.0], [0.8]]),
    "more components than cables": np.eye(6)[:, :4],
    "parallel": np.outer([0.6, 0.8], [1.0, -1.0, 2.0]),
    "in a plane": np.array([[1.0, -0.5, -0.5, 0.0], [0.0, 0.8, -0.8, 0.3], [0.0, 0.0, 0.0, 0.0]]),
}


@every_policy
@pytest.mark.parametrize("W", RANK_DEFICIENT.values(), ids=RANK_DEFICIENT)
def test_rank_deficient_rigs_are_rigs(W: NDArray[np.float64], name: str, policy: Any) -> None:
    n, m = W.shape
    t = np.linspace(1.0, 2.0, m)
    wrenches = np.stack([W @ t, np.zeros(n), W @ t + np.linspace(3.0, 5.0, n), 9 * W @ t])
    ones = np.ones((len(wrenches), m))
    batch = Case(np.stack([W] * len(wrenches)), wrenches, ones, 3 * ones, 2 * ones, np.ones(n))
    found = run(batch, name, policy)
    check_all(batch, found, name, policy)
    if family(name) in CLOSEST:
        assert found.status[0] == tl.Status.EXACT
        assert np.all(found.status[2:3] == tl.Status.NEAREST)


@every_solver
def test_nan_is_refused(name: str) -> None:
    structure, wrench = np.ones((4, 2, 3)), np.ones((4, 2))
    structure[2, 1, 0] = np.nan
    with pytest.raises(tl.errors.ShapeError, match=r"structure\[2, 1, 0\]"):
        tl.allocate(structure, wrench, (0.0, 1.0), name)
