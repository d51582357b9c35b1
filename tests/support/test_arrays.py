"""Arrays at every public door: nothing of them is dropped in silence, and refusals are in the house's words."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np
import pytest

import tensionlab as tl
from tensionlab import _native
from tensionlab.model import pose
from tensionlab.solvers import SOLVERS, as_fused_solver, make
from tensionlab.solvers.base import RANK_TOLERANCE, TOLERANCE
from tensionlab.support.arrays import (
    MAX_MAGNITUDE,
    Floats,
    angles,
    as_floats,
    common_axes,
    require_finite,
    tension_limits,
)

W, w, LIMITS = np.array([[1.0, -0.6, -0.6], [0.0, 0.8, -0.8]]), np.array([2.0, 1.0]), (1.0, 10.0)
LOSSY: dict[str, tuple[Callable[[Any], Any], str]] = {
    "complex": (lambda x: np.asarray(x) + 1e-3j, "complex"),
    "complex list": (lambda x: (np.asarray(x) + 0j).tolist(), "complex"),
    "masked": (lambda x: np.ma.masked_equal(np.asarray(x), np.asarray(x).ravel()[0]), "masked"),
    "list of masked": (lambda x: [np.ma.masked_equal(np.asarray(x), np.asarray(x).ravel()[0])], "masked"),
    "None": (lambda x: None, "None"),
    "text": (lambda x: np.asarray(x).astype(str), "numbers"),
    "dates": (lambda x: np.asarray(x).astype("datetime64[s]"), "numbers"),
    "dictionary": (lambda x: {"x": x}, "numbers"),
    "object": (lambda x: object(), "numbers"),
}
RIG = tl.load_rig("datasets/rigs/bartels2026-validation.toml")


@pytest.mark.parametrize("kind", LOSSY)
@pytest.mark.parametrize("name", ["structure", "wrench", "lower", "upper", "reference", "wrench_weights"])
def test_allocate_refuses_what_would_be_lost(name: str, kind: str) -> None:
    spoil, word = LOSSY[kind]
    given: dict[str, Any] = {"lower": 1.0, "upper": 10.0, "reference": w[:1], "wrench_weights": [1.0, 2.0]}
    given |= {"structure": W, "wrench": w}
    given[name] = spoil(given[name])
    if given["reference"] is None or given["wrench_weights"] is None:
        return  # that is their default
    with pytest.raises(tl.errors.ShapeError, match=rf"{name}.*{word}") as caught:
        tl.allocate(
            given["structure"],
            given["wrench"],
            (given["lower"], given["upper"]),
            reference=given["reference"],
            wrench_weights=given["wrench_weights"],
        )
    assert len(str(caught.value)) <= 300


@pytest.mark.parametrize("kind", LOSSY)
@pytest.mark.parametrize(
    "door",
    [
        lambda x: RIG.structure_matrix(x(RIG.home)),
        lambda x: tl.TensionLimits(x([1.0, 2.0]), [3.0, 4.0]),
        lambda x: tl.workspace.capacity_margin(x(np.ones((2, 3))), (1.0, 2.0)),
        lambda x: tl.Module(name="a", anchor=x([1.0, 2.0, 3.0]), lower=1.0, upper=2.0),
        lambda x: pose.rotations(x(np.eye(3)), 3, "rotation"),
    ],
    ids=["structure_matrix", "TensionLimits", "capacity_margin", "Module", "rotations"],
)
def test_so_does_every_other_door(door: Callable[[Callable[[Any], Any]], object], kind: str) -> None:
    spoil, _ = LOSSY[kind]
    with pytest.raises((tl.errors.ShapeError, tl.errors.RigError)):
        door(spoil)


def test_numbers_of_any_other_kind_are_taken() -> None:
    want = np.array([1.0, 2.0])
    for given in ([1, 2], (True, 2), np.array([1, 2], "int8"), np.array([1, 2], ">f4"), [Decimal(1), Decimal(2)]):
        np.testing.assert_array_equal(as_floats("x", given), want)
    nothing_masked = np.ma.array([1.0, 2.0], mask=False)
    np.testing.assert_array_equal(as_floats("x", nothing_masked), want)
    assert as_floats("x", want) is want
    assert np.isnan(as_floats("x", [np.nan]))


@pytest.mark.parametrize("wrench", [None, "up", [None, 1.0], {}, np.zeros(3), 1.0, [[1.0]], object(), print])
def test_no_wrong_wrench_shows_the_words_of_the_binding(wrench: Any) -> None:
    for prepared in (tl.Allocator(LIMITS), tl.Allocator(LIMITS, "dykstra")):
        for _ in range(2):  # the second call finds what the first has prepared
            with pytest.raises(tl.errors.ShapeError, match="wrench"):
                prepared(W, wrench)


@pytest.mark.parametrize(
    "change",
    [
        {"solver": None},
        {"solver": 3},
        {"solver": np.array([1.0, 2.0])},
        {"policy": ["force"]},
        {"policy": 1},
        {"policy": np.array(["force"])},
    ],
)
def test_a_wrong_solver_or_policy_is_refused_by_name(change: dict[str, Any]) -> None:
    with pytest.raises(tl.errors.InputError, match=next(iter(change))):
        tl.allocate(W, w, LIMITS, **change)


def shortened(array: Floats) -> Floats:
    return array[..., :-1]


def misaligned(array: Floats) -> Floats:
    """Return the same numbers, 4 bytes beyond a place of numbers, as a message may hold them."""
    return np.frombuffer(b"1234" + array.tobytes(), np.uint8)[4:].view(array.dtype).reshape(array.shape)


def test_misaligned_arrays_are_taken() -> None:
    given = misaligned(W)
    assert not given.flags.aligned
    assert as_floats("W", given).flags.aligned
    for solver in ("newton", "qp:daqp", "dykstra"):
        found = tl.allocate(given, misaligned(w), LIMITS, solver, reference=misaligned(np.ones(3)))
        expected = tl.allocate(W, w, LIMITS, solver, reference=np.ones(3))
        np.testing.assert_array_equal(found.tensions, expected.tensions)
    allocator = tl.Allocator(LIMITS)
    np.testing.assert_array_equal(allocator(given, misaligned(w)).tensions, allocator(W, w).tensions)


@pytest.mark.parametrize("wrong", ["wrench", "lower", "upper", "reference", "weights"])
@pytest.mark.parametrize(("change", "said"), [(shortened, "fit"), (misaligned, "must be aligned")])
def test_bindings_read_nothing_beyond_an_array_or_misaligned(
    wrong: str, change: Callable[[Floats], Floats], said: str
) -> None:
    arrays = {
        "structure": np.ones((2, 2, 3)),
        "wrench": np.ones((2, 2)),
        "lower": np.ones((2, 3)),
        "upper": np.ones((2, 3)),
        "reference": np.ones((2, 3)),
        "weights": np.ones(2),
    }
    arrays[wrong] = change(arrays[wrong])
    newton = _native.newton(RANK_TOLERANCE, TOLERANCE)
    calls: dict[str, Callable[..., object]] = {
        "allocate": lambda given: newton.allocate(given, 1, 1e100, TOLERANCE, RANK_TOLERANCE),
        "verify": lambda given: _native.verify(
            given, np.ones((2, 3)), np.ones((2, 2)), 1, TOLERANCE, RANK_TOLERANCE
        ),
    }
    for solver in map(make, SOLVERS):
        if compiled := as_fused_solver(solver):
            chosen = compiled._compiled()
            calls[type(solver).__name__] = lambda given, chosen=chosen: chosen.choose(given, 0)
    for call in calls.values():
        with pytest.raises(ValueError, match=said):
            call(tuple(arrays.values()))


def test_a_prepared_solver_wants_as_many_limits_of_each_kind() -> None:
    three, two = np.ones(3), np.ones(2)
    newton, numbers = _native.newton(RANK_TOLERANCE, TOLERANCE), (1e100, TOLERANCE, RANK_TOLERANCE)
    for limits in ((three, two, three), (two, three, three), (three, three, two)):
        with pytest.raises(ValueError, match="length"):
            _native.prepare_call(newton, *limits, two, 1, *numbers, tl.Allocation)
    with pytest.raises(ValueError, match="rule"):
        _native.prepare_call(newton, three, three, three, two, 4, *numbers, tl.Allocation)


def test_leading_axes_broadcast_to_their_common_axes() -> None:
    assert common_axes({"structure": (3, 1), "wrench": (4,), "limits": ()}) == (3, 4)
    assert common_axes({"structure": (3,), "wrench": (3,)}) == (3,)
    assert common_axes({"limits": ()}) == ()


@pytest.mark.parametrize(
    ("lower", "upper", "said"),
    [
        (1.0, 0.9, "lower = 1 N exceeds upper = 0.9 N"),
        ([0.5, 1.0], [6.0, 0.9], r"lower\[1\] = 1 N exceeds upper\[1\] = 0.9 N"),
    ],
)
def test_crossed_limits_are_named(lower: Any, upper: Any, said: str) -> None:
    with pytest.raises(tl.errors.ShapeError, match=said):
        tension_limits((lower, upper))
    tension_limits((lower, lower))


def test_a_number_too_large_is_named_by_its_index() -> None:
    require_finite("x", [0.0, 0.99 * MAX_MAGNITUDE], 1)
    for array, axes, said in (
        ([0.0, -1.5 * MAX_MAGNITUDE], 1, r"x\[1\] is -1\.5"),
        (np.nan, 0, "x is nan"),
        (1.0, 1, "x must be a vector"),
        ([1.0], 2, "x must be a matrix"),
    ):
        with pytest.raises(tl.errors.ShapeError, match=said):
            require_finite("x", array, axes)


def test_angles_of_known_forces() -> None:
    size = np.array([1e-3, 2.0, 1e-4, 1.0, 0.0])[:, None]
    turned = np.radians([30.0, 180.0, 1e-7, 90.0, 0.0])
    rendered = 3.0 * np.stack([np.cos(turned), np.sin(turned)], axis=-1)
    found = angles(size * [1.0, 0.0], rendered * size)
    np.testing.assert_allclose(found, [30.0, 180.0, 1e-7, 90.0, np.nan], rtol=1e-9)
