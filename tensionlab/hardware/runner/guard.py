"""What modules may be sent and what they pull: verified answers, limits, slew, derating, releases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocation, Allocator, Nearest, Solver, Status
from tensionlab.arrays import Floats
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.protocol.codes import LATCHED_STATES, Limit, State
from tensionlab.model.module import TensionLimits

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


MARGIN = 0.98
"""Share of what the winding stands that the host uses: currents are measured with some noise."""
HASTE = 8.0
"""How much of what is left of the winding's budget adds to the square of the current that the host asks for. The
firmware stops at 10 (`firmware/core/thermal.hpp`); with less, the host is before it, late telemetry or not."""
STEP_N = 0.05
"""Limits change by whole steps, in N, which nobody feels; solvers are prepared for each set of limits."""
WORTH_NOTING_N = 0.5
"""A limit that changes by so much is an event, in N."""


class Derating:
    """Upper tension limits of all modules, by the spent share of each winding's budget.

    From cold to spent a limit sinks from the rig's own to what the winding stands for ever, without a jump.

    Parameters
    ----------
    limits : TensionLimits
        Of all m modules, in N.
    continuous : (m,) array
        Tension that each winding stands for ever, in N.
    names : list of str
        Of the modules.

    Attributes
    ----------
    limits : TensionLimits
        As they are now.
    lowest : dict of str to float
        Of modules whose limit was below the rig's, the lowest that it has been, in N.
    """

    def __init__(self, limits: TensionLimits, continuous: Floats, names: list[str]) -> None:
        self._own, self._continuous, self._names = limits, np.asarray(continuous, dtype=np.float64), names
        self._noted = limits.upper.copy()
        self._thermal = np.zeros(len(names))
        # Spent shares from which on limits are lower; infinite: modules have not told yet.
        self._warm = 1.0 - ((limits.upper / (MARGIN * self._continuous)) ** 2 - 1.0) / HASTE
        self.limits = limits
        self.lowest: dict[str, float] = {}

    def update(self, thermal: Floats) -> list[tuple[int, str]]:
        """Set the limits by the spent shares (m,) of the budgets, 0 to 1; NaN where nothing new is known.

        Returns
        -------
        list of (int, str)
            Modules whose limit has changed by as much as is worth noting, and what to say of each.
        """
        if self.limits is self._own and not (thermal >= self._warm).any():
            return []
        self._thermal = np.where(np.isnan(thermal), self._thermal, np.clip(thermal, 0.0, 1.0))
        left = 1.0 - self._thermal
        stands = MARGIN * self._continuous * np.sqrt(1.0 + HASTE * left)
        upper = np.minimum(STEP_N * np.floor(stands / STEP_N), self._own.upper)
        upper = np.maximum(upper, self._own.lower)
        if (upper == self.limits.upper).all():
            return []
        self.limits = TensionLimits(self._own.lower, upper)
        changed = []
        for index in np.flatnonzero(upper < self._own.upper):
            name = self._names[index]
            self.lowest[name] = min(float(upper[index]), self.lowest.get(name, np.inf))
        whole = (upper == self._own.upper) & (self._noted < self._own.upper)
        for index in np.flatnonzero((np.abs(upper - self._noted) >= WORTH_NOTING_N) | whole):
            self._noted[index] = upper[index]
            changed.append((int(index), derated(upper[index], self._own.upper[index])))
        return changed

    def require_taut(self, index: int, thermal: float) -> None:
        """Refuse, by a `ModuleFault`, a module whose hot winding does not stand even its lower limit for ever."""
        stands, lower = float(self._continuous[index]), float(self._own.lower[index])
        if thermal >= 1.0 and stands < lower:
            raise ModuleFault(
                f'module "{self._names[index]}" is too hot: its winding stands {stands:.2f} N for ever, less than '
                f"its lower limit of {lower:g} N; lower the rig's limit, or let it cool",
                self._names[index],
                Limit.THERMAL,
            )


def derated(upper: float, own: float) -> str:
    """Say what a limit is now, in N."""
    if upper >= own:
        return f"pulls with up to {own:g} N again: its winding has cooled"
    return f"pulls with up to {upper:.2f} N in place of {own:g} N, to keep its winding from getting too hot"


RELAX_S = 2.0
"""A module that timed out keeps its cable taut for so long, in s, before it lets it go."""


@dataclass(frozen=True)
class Release:
    """How a module lets go.

    Attributes
    ----------
    tension : float
        What it pulls with until it begins to, in N.
    begin : float
        When it begins to, in s.
    slew : float
        How fast its tension sinks, in N/s.
    taut : float
        Where it stays for `RELAX_S`, in N; 0: nowhere.
    """

    tension: float
    begin: float
    slew: float
    taut: float = 0.0

    def pull(self, now: float) -> float:
        """Return what it pulls with at a time in s, in N."""
        passed = now - self.begin
        if passed <= 0.0:
            return self.tension
        taut = min(self.taut, self.tension)
        if passed > RELAX_S:
            return max(taut - self.slew * (passed - RELAX_S), 0.0)
        return max(self.tension - self.slew * passed, taut)


NOTHING = Release(0.0, 0.0, 1.0)


class ReleasedModules:
    """Modules that dropped out, and how each lets go.

    Parameters
    ----------
    lower : (m,) array
        Of the tension limits, in N.
    slews : sequence of float
        How fast each module lets its tension change, in N/s.
    ttl : float
        Of set-points, in s.
    """

    def __init__(self, lower: Floats, slews: Sequence[float], ttl: float) -> None:
        self._lower, self._slews, self._ttl = lower, slews, ttl
        self._releases: dict[int, Release] = {}

    def add(
        self, index: int, tension: float, heard: float, now: float, state: State | None, error: HardwareError
    ) -> None:
        """Note a module that dropped out.

        Parameters
        ----------
        index : int
        tension : float
            Of its last set-point, in N.
        heard, now : float
            When it was heard last, and what time it is, in s.
        state : State or None
            As it said last.
        error : HardwareError
            Why it dropped out.
        """
        slew, taut = self._slews[index], float(self._lower[index])
        if state in LATCHED_STATES:
            release = NOTHING  # its driver is off
        elif isinstance(error, LinkTimeout) and now - heard > self._ttl:
            # Nobody knows what still reaches it. What it follows lives on from then, and then it times out.
            release = Release(tension, heard + self._ttl, slew, taut)
        elif isinstance(error, LinkError) or state is State.TIMEOUT:
            release = Release(tension, now, slew, taut)  # a link that closes is a time that is out
        else:
            release = Release(tension, now, slew)  # it hears that it is to stop
        self._releases[index] = release

    def pulls(self, now: float) -> Floats:
        """Return what each pulls with at a time in s, (m,) in N; zero for those that take part."""
        pulls = np.zeros(len(self._lower))
        for index, release in self._releases.items():
            pulls[index] = release.pull(now)
        return pulls
