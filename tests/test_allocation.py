"""The interface itself: what it accepts, refuses, measures and believes."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.solvers import SOLVERS, as_fused_solver, make
from tensionlab.solvers.base import Answer, Policy, Problem, Verified
from tensionlab.support.arrays import Floats

PLANAR = np.array([[1.0, -0.6, -0.6], [0.0, 0.8, -0.8]])
LIMITS = ([1.0, 1.0, 1.0], [10.0, 10.0, 10.0])
REACHABLE, FAR = np.array([2.0, 1.0]), np.array([12.0, 6.0])


def test_result_of_one_problem_has_no_leading_axes() -> None:
    found = tl.allocate(PLANAR, REACHABLE, LIMITS)
    assert found.tensions.shape == (3,)
    assert found.wrench.shape == found.separation.shape == (2,)
    assert found.residual.shape == found.status.shape == found.scale.shape == found.iterations.shape == ()
    assert found.status == tl.Status.EXACT
    assert found.scale == 1
    assert not found.failures
    np.testing.assert_allclose(PLANAR @ found.tensions, REACHABLE, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("reference", "start"),
    [
        (None, [0.0, 0.0, 0.0]),
        ("lower", [1.0, 1.0, 1.0]),
        ("middle", [5.5, 5.5, 5.5]),
        ([2.0, 9.0, 4.0], [2.0, 9.0, 4.0]),
    ],
)
def test_answers_are_closest_to_the_reference(reference: Any, start: list[float]) -> None:
    # (1.2, 1, 1) spans the null space of PLANAR: a step along it either leaves the limits or goes away.
    found = tl.allocate(PLANAR, REACHABLE, LIMITS, reference=reference)
    null = np.array([1.2, 1.0, 1.0])
    for step in (-1e-3, 1e-3):
        other = found.tensions + step * null
        if np.all(other >= 1.0) and np.all(other <= 10.0):
            assert np.linalg.norm(other - start) > np.linalg.norm(found.tensions - start)
    np.testing.assert_allclose(PLANAR @ found.tensions, REACHABLE, rtol=0, atol=1e-9)


def test_limits_may_be_an_object_a_pair_or_numbers() -> None:
    @dataclass(frozen=True)
    class Limits:
        lower: Floats
        upper: Floats

    pair = tl.allocate(PLANAR, REACHABLE, LIMITS)
    named = tl.allocate(PLANAR, REACHABLE, Limits(*map(np.array, LIMITS)))
    numbers = tl.allocate(PLANAR, REACHABLE, (1, 10))
    np.testing.assert_array_equal(pair.tensions, named.tensions)
    np.testing.assert_array_equal(pair.tensions, numbers.tensions)


def test_limits_and_references_broadcast_too() -> None:
    lower = np.ones((4, 1, 3)) * np.arange(1, 5)[:, None, None]
    reference = np.random.default_rng(0).uniform(1, 9, (5, 3))
    found = tl.allocate(PLANAR, REACHABLE, (lower, 10.0), reference=reference)
    assert found.tensions.shape == (4, 5, 3)
    for i, j in np.ndindex(4, 5):
        alone = tl.allocate(PLANAR, REACHABLE, (lower[i, 0], 10.0), reference=reference[j])
        np.testing.assert_allclose(found.tensions[i, j], alone.tensions, rtol=0, atol=1e-10)


def test_weights_choose_the_nearest_wrench() -> None:
    light, heavy = (
        tl.allocate(PLANAR, FAR, LIMITS, policy="force", wrench_weights=[1, weight]) for weight in (1e-3, 1e3)
    )
    error_light, error_heavy = FAR - light.wrench, FAR - heavy.wrench
    assert abs(error_heavy[1]) < 0.01
    assert abs(error_light[1]) > 0.1
    assert light.residual == pytest.approx(np.sqrt(error_light @ np.diag([1, 1e-3]) @ error_light))
    assert heavy.residual == pytest.approx(np.sqrt(error_heavy @ np.diag([1, 1e3]) @ error_heavy))


def test_scale_tells_how_much_of_the_wrench_is_rendered() -> None:
    along = tl.allocate(PLANAR, np.stack([REACHABLE, FAR, 2 * FAR]), LIMITS, policy="direction")
    np.testing.assert_allclose(along.scale, [1, 8 / 15, 4 / 15], rtol=0, atol=1e-9)
    np.testing.assert_allclose(along.wrench, along.scale[:, None] * [REACHABLE, FAR, 2 * FAR], atol=1e-8)
    # Three parallel cables that must pull: nothing points up, not even zero.
    stuck = tl.allocate([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]], [0.0, 5.0], LIMITS, policy="direction")
    assert stuck.status == tl.Status.NEAREST
    assert np.isnan(stuck.scale)
    np.testing.assert_allclose(stuck.tensions, [1, 1, 1], rtol=0, atol=1e-9)
    for policy in ("force", "tension"):
        assert np.isnan(tl.allocate(PLANAR, FAR, LIMITS, policy=policy).scale)


def test_threads_may_share_an_allocator() -> None:
    rng = np.random.default_rng(0)
    sizes = ((2, 3), (3, 5))
    structures = {size: rng.normal(size=(50, *size)) for size in sizes}
    wrenches = {size: structures[size] @ rng.uniform(0.5, 6.0, size[1]) for size in sizes}
    shared = tl.Allocator((0.5, 6.0))
    wanted = {size: tl.allocate(structures[size], wrenches[size], (0.5, 6.0)).tensions for size in sizes}

    def work(number: int) -> int:
        wrong = 0
        for turn in range(1500):
            size, row = sizes[(turn + number) % 2], turn % 50
            found = shared(structures[size][row], wrenches[size][row])
            wrong += not np.array_equal(found.tensions, wanted[size][row])
        return wrong

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as threads:
            assert sum(threads.map(work, range(8))) == 0
    finally:
        sys.setswitchinterval(before)


def test_one_call_after_another_takes_the_limits_as_they_are_now() -> None:
    """Prepared allocators are kept, by the numbers and not by who holds them."""
    W, w = np.array([[1.0, -1.0]]), np.array([3.0])
    lower, upper = np.array([1.0, 1.0]), np.array([6.0, 6.0])
    assert tl.allocate(W, w, (lower, upper)).tensions.tolist() == [4.0, 1.0]
    lower[1] = 2.0
    assert tl.allocate(W, w, (lower, upper)).tensions.tolist() == [5.0, 2.0]
    assert tl.allocate(W, w, tl.TensionLimits(lower, upper), reference="middle").tensions.tolist() == [5.25, 2.25]
    upper[0] = 4.0
    assert tl.allocate(W, w, (lower, upper)).status == tl.Status.NEAREST
    assert tl.allocate(W, w, (1.0, 6.0)).tensions.tolist() == [4.0, 1.0]
    lower[0] = 5.0
    for _ in range(2):  # what is refused is not kept
        with pytest.raises(tl.errors.ShapeError, match="lower"):
            tl.allocate(W, w, (lower, upper))
    with pytest.raises(tl.errors.InputError, match="policy is"):
        tl.allocate(W, w, (np.ones(2), np.ones(2)), policy=["force"])


def test_inputs_are_left_alone() -> None:
    arrays = [
        PLANAR.copy(),
        FAR.copy(),
        np.array(LIMITS[0]),
        np.array(LIMITS[1]),
        np.array([20.0, -5.0, 3.0]),
    ]
    for array in arrays:
        array.setflags(write=False)
    structure, wrench, lower, upper, reference = arrays
    for name in ("newton", "dykstra", "pseudoinverse", "closed-form", "qp"):
        tl.allocate(structure, wrench, (lower, upper), name, reference)


def test_raise_for_status() -> None:
    fine = tl.allocate(PLANAR, REACHABLE, LIMITS)
    assert fine.raise_for_status() is fine
    mixed = tl.allocate(PLANAR, np.stack([REACHABLE, FAR]), LIMITS)
    with pytest.raises(tl.errors.Unreachable, match="1 of 2") as caught:
        mixed.raise_for_status()
    assert caught.value.allocation is mixed


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["structure", "wrench", "lower", "upper", "reference", "wrench_weights"])
def test_what_is_not_finite_is_refused_by_name_and_index(name: str, bad: float) -> None:
    arrays = {
        "structure": PLANAR.copy(),
        "wrench": REACHABLE.copy(),
        "lower": np.ones(3),
        "upper": np.full(3, 9.0),
        "reference": np.ones(3),
        "wrench_weights": np.ones(2),
    }
    index = (1, 2) if name == "structure" else (1,)
    arrays[name][index] = bad
    place = ", ".join(map(str, index))
    with pytest.raises(tl.errors.ShapeError, match=rf"{name}\[{place}\]"):
        tl.allocate(
            arrays["structure"],
            arrays["wrench"],
            (arrays["lower"], arrays["upper"]),
            reference=arrays["reference"],
            wrench_weights=arrays["wrench_weights"],
        )


@pytest.mark.parametrize("lower", [7, 6 + 1e-9])
def test_crossed_limits_are_refused_by_cable(lower: float) -> None:
    with pytest.raises(tl.errors.ShapeError, match=rf"lower.*\b2\b.*{lower:g} N.*upper.*6 N"):
        tl.allocate(PLANAR, REACHABLE, ([1, 1, lower], [9, 9, 6]))


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"wrench": np.zeros(3)}, ("wrench", "structure")),
        ({"wrench": np.zeros(())}, ("wrench",)),
        ({"structure": np.zeros(3)}, ("structure",)),
        ({"structure": np.zeros((2, 0))}, ("structure", "0 cables")),
        ({"structure": np.zeros((7, 3)), "wrench": np.zeros(7)}, ("structure", "7")),
        ({"structure": np.zeros((2, 33))}, ("structure", "33")),
        ({"limits": (np.zeros(4), 9.0)}, ("lower", "4")),
        ({"limits": (0.0, np.ones((2, 4)))}, ("upper", "4")),
        ({"reference": np.zeros(2)}, ("reference", "2")),
        ({"wrench_weights": np.ones(3)}, ("wrench_weights", "3")),
        ({"wrench_weights": [1.0, 0.0]}, ("wrench_weights", "positive")),
        ({"structure": np.zeros((4, 2, 3)), "wrench": np.zeros((5, 2))}, ("structure", "wrench")),
        ({"wrench": "up"}, ("wrench",)),
    ],
)
def test_shapes_that_cannot_form_a_problem_are_refused(change: dict[str, Any], names: tuple[str, ...]) -> None:
    arguments: dict[str, Any] = {"structure": PLANAR, "wrench": REACHABLE, "limits": LIMITS} | change
    with pytest.raises(tl.errors.ShapeError) as caught:
        tl.allocate(**arguments)
    for name in names:
        assert name in str(caught.value)


def test_unknown_names_are_refused_with_a_suggestion() -> None:
    with pytest.raises(tl.errors.UnknownSolver, match=r"newtn.*newton"):
        tl.allocate(PLANAR, REACHABLE, LIMITS, "newtn")
    with pytest.raises(tl.errors.UnknownSolver, match=r"clarabell.*clarabel"):
        tl.allocate(PLANAR, REACHABLE, LIMITS, "qp:clarabell")
    with pytest.raises(ValueError, match=r"top.*lower.*middle"):
        tl.allocate(PLANAR, REACHABLE, LIMITS, reference="top")


def test_a_policy_that_is_not_supported_names_those_that_are() -> None:
    with pytest.raises(ValueError, match=r"Dykstra.*'force'.*'tension'"):
        tl.allocate(PLANAR, REACHABLE, LIMITS, "dykstra", policy="force")
    with pytest.raises(ValueError, match=r"Pseudoinverse.*'force'"):
        tl.allocate(PLANAR, REACHABLE, LIMITS, "pseudoinverse", policy="force")
    with pytest.raises(ValueError, match=r"sideways.*'force', 'tension', 'direction'"):
        tl.allocate(PLANAR, REACHABLE, LIMITS, policy="sideways")  # type: ignore[arg-type]
    plain = np.array(LIMITS[0]), np.array(LIMITS[1])  # limits that a single call hands to the kernel as they are
    for unknown in ("", "sideways"):
        with pytest.raises(tl.errors.InputError, match=rf"policy='{unknown}'"):
            tl.allocate(PLANAR, REACHABLE, plain, policy=unknown)  # type: ignore[arg-type]


def test_a_solver_may_be_an_instance() -> None:
    found = tl.allocate(PLANAR, REACHABLE, LIMITS, tl.solvers.Dykstra(tolerance=1e-12))
    exact = tl.allocate(PLANAR, REACHABLE, LIMITS)
    np.testing.assert_allclose(found.tensions, exact.tensions, rtol=0, atol=1e-9)


@dataclass(frozen=True)
class Stranger:
    """A solver from elsewhere that answers and claims what the test tells it."""

    tensions: tuple[float, ...]
    separation: tuple[float, ...] | None = None
    reason: str | None = None

    objective: ClassVar[str] = "none"
    policies: ClassVar[tuple[Policy, ...]] = ("force", "tension", "direction")

    def solve(self, problem: Problem) -> Answer:
        size = len(problem)
        return Answer(
            np.tile(self.tensions, (size, 1)).astype(float),
            np.full(size, 7),
            None if self.separation is None else np.tile(self.separation, (size, 1)).astype(float),
            {} if self.reason is None else dict.fromkeys(range(size), self.reason),
        )


NAN = (np.nan, np.nan, np.nan)


def test_a_stranger_who_is_right_is_believed_after_measuring() -> None:
    for policy in Stranger.policies:
        truth = tl.allocate(PLANAR, FAR, LIMITS, policy=policy)
        found = tl.allocate(PLANAR, FAR, LIMITS, Stranger(tuple(truth.tensions)), policy=policy)
        assert found.status == tl.Status.NEAREST
        assert found.iterations == 7
        np.testing.assert_allclose(found.scale, truth.scale, rtol=0, atol=1e-9)
        d = found.separation
        assert d @ FAR > np.maximum(d @ PLANAR, 10 * d @ PLANAR).sum()


@pytest.mark.parametrize("policy", Stranger.policies)
@pytest.mark.parametrize("claim", [(1.0, 0.5), (-1.0, -0.5), (1e300, 1e300), (np.nan, np.inf), (0.0, 0.0)])
def test_a_liar_is_not_believed(policy: Policy, claim: tuple[float, float]) -> None:
    # Reachable, but not by these tensions: no claimed direction makes that NEAREST.
    lie = tl.allocate(PLANAR, REACHABLE, LIMITS, Stranger((5.0, 1.0, 9.0), claim), policy=policy)
    assert lie.status == tl.Status.UNPROVEN
    assert not lie.separation.any()
    # Out of reach, but these tensions are not the best: nor is that NEAREST.
    lazy = tl.allocate(PLANAR, FAR, LIMITS, Stranger((5.0, 1.0, 9.0), claim), policy=policy)
    assert lazy.status == tl.Status.UNPROVEN


def test_only_built_in_solvers_may_verify_their_own_answers() -> None:
    class Boaster(Stranger):
        def solve_verified(self, problem: Problem) -> Verified:
            raise AssertionError("never called")

        prepare = solve_verified

    for wrench in (REACHABLE, np.stack([REACHABLE, FAR])):
        found = tl.allocate(PLANAR, wrench, LIMITS, Boaster((5.0, 1.0, 9.0)))
        assert np.all(found.status == tl.Status.UNPROVEN)


def test_a_broken_backend_fails_with_its_reason() -> None:
    found = tl.allocate(PLANAR, np.stack([REACHABLE, FAR]), LIMITS, Stranger(NAN, reason="no licence"))
    assert np.all(found.status == tl.Status.FAILED)
    assert np.isnan(found.tensions).all()
    assert np.isnan(found.scale).all()
    assert dict(found.failures) == {0: "no licence", 1: "no licence"}
    with pytest.raises(tl.errors.Unreachable, match="no licence"):
        found.raise_for_status()
    unexplained = tl.allocate(PLANAR, REACHABLE, LIMITS, Stranger(NAN))
    assert unexplained.status == tl.Status.FAILED
    assert unexplained.failures[0]


@pytest.mark.parametrize("name", [name for name in SOLVERS if as_fused_solver(make(name))])
def test_a_problem_has_the_same_answer_alone_and_in_a_batch(name: str) -> None:
    rng = np.random.default_rng(0)
    structure = rng.normal(size=(40, 2, 4))
    structure[0, 1] = 0.0  # more redundancy than a polygon has dimensions
    wrench = np.einsum("bnm,m->bn", structure, np.ones(4)) + rng.normal(scale=4.0, size=(40, 2))
    allocator = tl.Allocator((np.full(4, 0.5), np.full(4, 6.0)), name)
    batch = allocator(structure, wrench)
    assert batch.exact.any() == (name != "spidar")  # whose error is small, never nothing
    assert not batch.exact.all()
    for row in range(len(wrench)):
        unprepared = tl.allocate(structure[row], wrench[row].tolist(), (0.5, 6), name)
        for single in (allocator(structure[row], wrench[row]), unprepared):
            for field in ("tensions", "wrench", "residual", "status", "scale", "iterations", "separation"):
                np.testing.assert_array_equal(getattr(single, field), getattr(batch, field)[row])
                assert getattr(single, field).dtype == getattr(batch, field).dtype
            assert single.failures == ({0: batch.failures[row]} if row in batch.failures else {})
    assert list(batch.failures) == ([0] if name == "polygon" else [])


@pytest.mark.parametrize("weight", [1e-6, 1e-10, 1e-16])
def test_weights_make_no_error_vanish(weight: float) -> None:
    # The second component is out of reach, however little it counts; the first can be had exactly.
    found = tl.allocate(
        [[1.0, 1.0], [1.0, -1.0]], [6.0, 20.0], (0.5, 6.0), policy="force", wrench_weights=[1.0, weight]
    )
    assert found.status == tl.Status.NEAREST
    within = tl.allocate([[1.0, 1.0], [1.0, -1.0]], [6.0, 2.0], (0.5, 6.0), wrench_weights=[1.0, weight])
    assert within.status == tl.Status.EXACT
    np.testing.assert_allclose(within.tensions, [4.0, 2.0], atol=1e-9)


def test_a_list_that_holds_itself_is_refused_by_name() -> None:
    endless: list[Any] = []
    endless.append(endless)
    with pytest.raises(tl.errors.ShapeError, match="wrench is nested too deeply, or holds itself"):
        tl.allocate([[1.0, -1.0]], endless, (0.5, 6.0))


def test_numbers_whose_squares_overflow_are_refused() -> None:
    with pytest.raises(tl.errors.ShapeError, match=r"wrench\[0\] is 1e\+200"):
        tl.allocate([[1.0, -1.0]], [1e200], (0.5, 6.0))
