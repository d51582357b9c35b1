"""What stands between a solver and the modules: no unproved answer, none outside the limits, no leap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocation, Allocator, Nearest, Solver, Status
from tensionlab.arrays import Floats
from tensionlab.errors import HardwareError
from tensionlab.model.limits import TensionLimits

PROVED = frozenset((int(Status.EXACT), int(Status.NEAREST)))
MAX_PREPARED = 256
"""So many sets of limits are kept prepared: windings warm and cool step by step."""
EXACT_SOLVER = "newton"
"""Answers where the chosen solver leaves it unproved."""


class GuardedAllocator:
    """Which tensions, of the modules that take part, render a wrench?

    The solver's answer, if it is proved; else that of the exact solver. A module that does not take part has a
    tension of zero.

    Parameters
    ----------
    limits : TensionLimits
        Of all m modules, in N.
    solver : str or Solver
        As in `tensionlab.allocate`.
    nearest : str or None
        What to render out of reach; None: the solver's own.
    """

    def __init__(self, limits: TensionLimits, solver: str | Solver, nearest: Nearest | None = None) -> None:
        self._limits = limits
        self._solver: str | Solver = solver
        self._nearest = nearest
        self._prepared: dict[bytes, tuple[Allocator, Allocator]] = {}
        everyone = np.ones(np.size(limits.lower), dtype=bool)
        self._solver = self.solver = self._for(everyone, limits)[0].solver

    def __call__(
        self, structure: Floats, wrench: Floats, part: NDArray[np.bool_], limits: TensionLimits | None = None
    ) -> tuple[Allocation, bool]:
        """Allocate, and tell whether the exact solver had to.

        Parameters
        ----------
        structure : (n, m) array
        wrench : (n,) array
        part : (m,) array of bool
            Modules that take part.
        limits : TensionLimits, optional
            In place of those from the beginning.
        """
        chosen, exact = self._for(part, self._limits if limits is None else limits)
        allocation = chosen(structure, wrench)
        if int(allocation.status) in PROVED:
            return allocation, False
        return exact(structure, wrench), True

    def _for(self, part: NDArray[np.bool_], limits: TensionLimits) -> tuple[Allocator, Allocator]:
        key = part.tobytes() + limits.upper.tobytes()
        if key not in self._prepared:
            if len(self._prepared) >= MAX_PREPARED:
                self._prepared.clear()
            limits = limits.only(part)
            chosen = Allocator(limits, self._solver, nearest=self._nearest)
            self._prepared[key] = chosen, Allocator(limits, EXACT_SOLVER, nearest=chosen.nearest)
        return self._prepared[key]


def require_within(tensions: Floats, limits: TensionLimits, part: NDArray[np.bool_], names: list[str]) -> None:
    """Refuse tensions that a module must never be sent.

    Raises
    ------
    HardwareError
        Naming the module; NaN included.
    """
    within = (limits.lower <= tensions) & (tensions <= limits.upper) | ~part
    if not within.all():
        index = int(np.argmin(within))
        raise HardwareError(
            f'module "{names[index]}" would be sent {tensions[index]:g} N; its limits are '
            f"{limits.lower[index]:g} to {limits.upper[index]:g} N"
        )


def approach(before: Floats, wanted: Floats, most: float) -> Floats:
    """Which tensions are next, if none may change by more than ``most`` N?

    All go the same share of their way, so that on the way the wrench goes straight from the old to the new one.
    """
    change = wanted - before
    largest = float(np.abs(change).max(initial=0.0))
    return wanted if largest <= most else before + change * (most / largest)
