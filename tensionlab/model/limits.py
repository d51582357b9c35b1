"""How much each cable may be pulled: `TensionLimits`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import as_floats
from tensionlab.errors import ShapeError


@dataclass(frozen=True, eq=False)
class TensionLimits:
    """Between which tensions may each cable be pulled?

    Attributes
    ----------
    lower, upper : (m,) read-only arrays
        Smallest and largest tension of each cable, in N. ``lower == upper`` is legal: such a cable has no
        choice.

    Raises
    ------
    ShapeError
        If the shapes differ, there is no cable, an entry is NaN or infinite, or a lower limit is above its
        upper.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]

    def __post_init__(self) -> None:
        lower, upper = (
            as_floats(f"tension limits: {name}", getattr(self, name)).copy() for name in ("lower", "upper")
        )
        if lower.ndim != 1 or lower.shape != upper.shape:
            raise ShapeError(
                f"tension limits: lower has shape {lower.shape} and upper {upper.shape}; "
                "give one lower and one upper limit a cable, both of shape (m,)"
            )
        if lower.size == 0:
            raise ShapeError("tension limits: no cable; give at least one lower and one upper limit")
        for name, values in (("lower", lower), ("upper", upper)):
            if not np.isfinite(values).all():
                index = int(np.flatnonzero(~np.isfinite(values))[0])
                raise ShapeError(f"tension limits: {name}[{index}] is {values[index]}; give a finite tension in N")
        if (lower > upper).any():
            index = int(np.flatnonzero(lower > upper)[0])
            raise ShapeError(
                f"tension limits: lower[{index}] = {lower[index]} is above upper[{index}] = {upper[index]}; "
                "give lower <= upper, in N"
            )
        lower.setflags(write=False)
        upper.setflags(write=False)
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)

    def only(self, part: NDArray[np.bool_]) -> TensionLimits:
        """Which limits leave all but some cables, (m,) array of bool, without tension?"""
        return TensionLimits(np.where(part, self.lower, 0.0), np.where(part, self.upper, 0.0))
