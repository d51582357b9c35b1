"""Array types; arrays turned into float64 without loss, checked, and broadcast."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.errors import ShapeError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Scalar = TypeVar("Scalar", bound=np.generic)

MAX_MAGNITUDE = 1e100  # entries of this size or more are refused: their squares would overflow


def as_floats(name: str, values: ArrayLike) -> Floats:
    """Convert numbers to a contiguous, aligned float64 array, without a copy if they are one already.

    NaN and infinity pass. A `ShapeError`, with the ``name``, refuses complex parts, masked entries, None, text,
    dates and ragged lists.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return _aligned(np.asarray(values, order="C"))
    if values is None:
        raise ShapeError(f"{name} is None; give numbers")
    try:
        if _masked(values):
            raise ShapeError(f"{name} has masked entries; fill them or leave them out")
        given = np.asarray(values)
        if given.dtype.kind == "c":
            raise ShapeError(f"{name} is complex; give real numbers, as {name}.real would")
        if given.dtype.kind in "biufO":
            return _aligned(np.asarray(given, dtype=np.float64, order="C"))
    except RecursionError:
        raise ShapeError(f"{name} is nested too deeply, or holds itself; give an array of numbers") from None
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, ShapeError):
            raise
        raise ShapeError(f"{name} is not an array of numbers: {str(error)[:150]}") from None
    raise ShapeError(f"{name} is not an array of numbers: its entries are {given.dtype.name:.60}")


def _aligned(values: Floats) -> Floats:
    """Copy an unaligned array, which no kernel may read."""
    return values if values.flags.aligned else values.copy()


def _masked(values: object) -> bool:
    """Return whether anything is masked, also in lists and tuples, whose masks NumPy silently drops."""
    if isinstance(values, list | tuple):
        return any(_masked(value) for value in values)
    # By its attribute: to name numpy.ma would load it.
    return isinstance(values, np.ndarray) and bool(np.any(getattr(values, "mask", False)))


class Limits(Protocol):
    """Anything with tension limits, as `tensionlab.TensionLimits`."""

    @property
    def lower(self) -> Floats:
        """Minimum tensions, (..., m), N."""

    @property
    def upper(self) -> Floats:
        """Maximum tensions, (..., m), N."""


def tension_limits(limits: Limits | tuple[ArrayLike, ArrayLike]) -> tuple[Floats, Floats]:
    """Return the lower and upper limits, checked to be finite and not crossed."""
    try:
        lower, upper = limits if isinstance(limits, tuple) else (limits.lower, limits.upper)
    except (AttributeError, ValueError):
        wanted = "a pair (lower, upper) or have those attributes, as rig.limits has"
        raise ShapeError(f"limits must be {wanted}; got {limits!r:.60}") from None
    low, high = readonly_copy(require_finite("lower", lower, 0)), readonly_copy(require_finite("upper", upper, 0))
    try:
        crossed = low > high
    except ValueError:
        raise ShapeError(f"lower has shape {low.shape}, upper {high.shape}; they do not broadcast") from None
    if crossed.any():
        entry = tuple(int(i) for i in np.argwhere(crossed)[0]) if crossed.ndim else ()
        values = [float(limit[entry]) for limit in np.broadcast_arrays(low, high)]
        where = f"[{', '.join(map(str, entry))}]" if entry else ""
        raise ShapeError(f"lower{where} = {values[0]:g} N exceeds upper{where} = {values[1]:g} N")
    return low, high


def readonly_copy(array: Floats) -> Floats:
    """Return a read-only copy of an array."""
    copy = np.array(array)  # also of a scalar, which the mean of two arrays without axes is
    copy.flags.writeable = False
    return copy


def require_finite(name: str, array: ArrayLike, axes: int) -> Floats:
    """Return contiguous floats with at least ``axes`` axes; refuse an entry that is not finite, by its index."""
    values = as_numeric(name, array, axes)
    check(name, values)
    return values


def as_numeric(name: str, array: ArrayLike, axes: int) -> Floats:
    """Return contiguous floats with at least ``axes`` axes, finite or not."""
    values = as_floats(name, array)
    if values.ndim < axes:
        kind = "a matrix" if axes == 2 else "a vector"
        raise ShapeError(f"{name} must be {kind}, with leading axes if there are many; got shape {values.shape}")
    return values


def check(name: str, values: Floats) -> None:
    """Refuse NaN, infinity and numbers whose squares would overflow."""
    if not _native.all_within(values, MAX_MAGNITUDE):
        index = tuple(int(i) for i in np.argwhere(~(np.abs(values) < MAX_MAGNITUDE))[0])
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise ShapeError(f"{where} is {values[index]}; every entry must be finite, below {MAX_MAGNITUDE:g}")


def check_size(n: int, m: int) -> None:
    """Refuse more wrench components and cables than the kernels serve, and none."""
    if not (1 <= n <= _native.MAX_COMPONENTS and 1 <= m <= _native.MAX_CABLES):
        limits = f"1 to {_native.MAX_COMPONENTS} and 1 to {_native.MAX_CABLES}"
        raise ShapeError(f"structure has {n} wrench components and {m} cables; it must have {limits}")


def broadcast_last_axis(name: str, array: Floats, count: int, what: str) -> Floats:
    """Return one entry for each of ``count`` cables or rows; a single number is repeated."""
    own = array.shape[-1:]
    if own == (count,):
        return array
    if own not in ((), (1,)):
        raise ShapeError(f"{name} has {own[0]} entries where structure has {count} {what}")
    return (array if own else array[None]).repeat(count, axis=-1)


def pad_last_axis(array: Floats, count: int) -> Floats:
    """Return an array (..., count), with zeros after the entries that are given."""
    return np.pad(array, [(0, 0)] * (array.ndim - 1) + [(0, count - array.shape[-1])])


def common_axes(axes: Mapping[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the shape to which the leading axes of the named arrays broadcast."""
    different = {shape for shape in axes.values() if shape}
    if len(different) < 2:
        return different.pop() if different else ()
    try:
        return np.broadcast_shapes(*different)
    except ValueError:
        shapes = ", ".join(f"{name} {shape}" for name, shape in axes.items() if shape)
        raise ShapeError(f"leading axes do not broadcast together: {shapes}; insert axes of length 1") from None


def flatten_batch(array: NDArray[Scalar], shape: tuple[int, ...], inner: int) -> NDArray[Scalar]:
    """Broadcast an array to all problems, its leading axes made one; read-only, a view where possible."""
    full = shape + array.shape[array.ndim - inner :]
    if array.shape != full:
        array = np.broadcast_to(array, full)
    made_one = array.reshape(math.prod(shape), *full[len(shape) :])
    made_one.flags.writeable = False
    return made_one


def angles(desired: Floats, rendered: Floats) -> Floats:
    """Return the angles between desired and rendered forces, (K, d), in degrees, (K,).

    NaN where either force is zero or NaN and so has no direction.
    """
    length = np.linalg.norm(desired, axis=1) * np.linalg.norm(rendered, axis=1)
    # arccos of the cosine loses small angles to rounding; lengths of sum and difference (Kahan) do not.
    a = desired * np.linalg.norm(rendered, axis=1)[:, None]
    b = rendered * np.linalg.norm(desired, axis=1)[:, None]
    half = np.arctan2(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
    return np.where(length > 0, np.degrees(2 * half), np.nan)
