"""Arrays as people give them, turned into float64 without loss."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import ShapeError

Floats = NDArray[np.float64]


def as_floats(name: str, values: ArrayLike) -> Floats:
    """Convert numbers to a float64 array, contiguous; one that is so already is returned as it is.

    Parameters
    ----------
    name : str
        What the error calls them.
    values : array_like
        Real numbers; NaN and infinity pass.

    Raises
    ------
    ShapeError
        If something would be lost or made up: complex parts, masked entries, None, text, dates, ragged lists.
    """
    if type(values) is np.ndarray and values.dtype == np.float64:
        return np.asarray(values, order="C")
    if values is None:
        raise ShapeError(f"{name} is None; give numbers")
    if _masked(values):
        raise ShapeError(f"{name} has masked entries; fill them or leave them out")
    try:
        given = np.asarray(values)
        if given.dtype.kind == "c":
            raise ShapeError(f"{name} is complex; give real numbers, as {name}.real would")
        if given.dtype.kind in "biufO":
            return np.asarray(given, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, ShapeError):
            raise
        raise ShapeError(f"{name} is not an array of numbers: {str(error)[:150]}") from None
    raise ShapeError(f"{name} is not an array of numbers: its entries are {given.dtype.name:.60}")


def _masked(values: object) -> bool:
    """Whether anything is masked, in lists and tuples too, from which NumPy would take it without a word."""
    if isinstance(values, list | tuple):
        return any(_masked(each) for each in values)
    # By its attribute: to name numpy.ma would load it.
    return isinstance(values, np.ndarray) and bool(np.any(getattr(values, "mask", False)))
