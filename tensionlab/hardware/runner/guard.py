"""Guard of the set-points: verified answers, limits, slew, derating, releases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.allocation import Allocation, Allocator, Policy, Solver, Status, resolve_solver
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.protocol.codes import LATCHED_STATES, Limit, State
from tensionlab.model.module import TensionLimits
from tensionlab.support.arrays import Floats

CERTIFIED = frozenset((int(Status.EXACT), int(Status.NEAREST)))
MAX_PREPARED = 256  # sets of limits that are kept prepared: windings warm and cool step by step
EXACT_SOLVER = "newton"  # fallback where the chosen solver leaves its answer unproven


class GuardedAllocator:
    """Allocator whose answers are certified: the solver's, or else that of the exact solver.

    A module that does not take part has a tension of zero. The policy `policy` is the solver's own if None.
    """

    def __init__(self, solver: str | Solver, policy: Policy | None = None) -> None:
        self._solver, self._policy = resolve_solver(solver, policy)
        self._prepared: dict[bytes, tuple[Allocator, Allocator]] = {}

    def __call__(
        self, structure: Floats, wrench: Floats, part: NDArray[np.bool_], limits: TensionLimits
    ) -> tuple[Allocation, bool]:
        """Return an allocation with the modules in `part` (m,), and whether the exact solver made it."""
        chosen, exact = self._for(part, limits)
        allocation = chosen(structure, wrench)
        if int(allocation.status) in CERTIFIED:
            return allocation, False
        return exact(structure, wrench), True

    def _for(self, part: NDArray[np.bool_], limits: TensionLimits) -> tuple[Allocator, Allocator]:
        key = part.tobytes() + limits.upper.tobytes()
        if key not in self._prepared:
            if len(self._prepared) >= MAX_PREPARED:
                self._prepared.clear()
            limits = limits.only(part)
            chosen = Allocator(limits, self._solver, policy=self._policy)
            self._prepared[key] = chosen, Allocator(limits, EXACT_SOLVER, policy=chosen.policy)
        return self._prepared[key]


class NextTensions(NamedTuple):
    """Tensions (m,) to go on from, those that are commanded (NaN elsewhere), and whether slew limits them."""

    tensions: Floats
    commanded: Floats
    slew_limited: bool


def next_tensions(
    before: Floats,
    chosen: Floats,
    free: NDArray[np.bool_],
    limits: TensionLimits,
    max_change: float,
    names: Sequence[str],
) -> NextTensions:
    """Return the next tensions of all modules, none of which changes by more than `max_change` N.

    The `free` (m,) go from those `before` to those `chosen`, by the same share of their way each, so that the
    wrench goes straight from the old to the new one. A `HardwareError` that names the module if one would be sent
    what is outside its limits, NaN among that.
    """
    tensions, commanded, slew_limited, refused = _native.next_tensions(
        before, chosen, free, limits.lower, limits.upper, max_change
    )
    if refused >= 0:
        raise HardwareError(
            f'module "{names[refused]}" would be sent {chosen[refused]:g} N; its limits are '
            f"{limits.lower[refused]:g} to {limits.upper[refused]:g} N"
        )
    return NextTensions(tensions, commanded, slew_limited)


# Share of a winding's continuous tension that the host uses: currents are measured with some noise.
CONTINUOUS_SHARE = 0.98
# Gain from what is left of the winding's budget to the square of the current that the host commands. The firmware
# stops at 10 (`firmware/core/thermal.hpp`); with less, the host is before it, late telemetry or not.
DERATING_GAIN = 8.0
STEP_N = 0.05  # limits change by whole steps, too small to be noticed; solvers are prepared for each set of limits
EVENT_STEP_N = 0.5  # a limit that changes by so much is an event


class Derating:
    """Upper tension limits of all modules, by the spent share of each winding's budget.

    From cold to spent a limit falls from the rig's own to the winding's continuous tension (m,) in N, without a
    jump. `limits` are those now. `lowest` has, of modules whose limit was below the rig's, the lowest that it has
    been, in N.
    """

    def __init__(self, limits: TensionLimits, continuous: Floats, names: list[str]) -> None:
        self._own, self._continuous, self._names = limits, np.asarray(continuous, dtype=np.float64), names
        self._noted = limits.upper.copy()
        self._thermal = np.zeros(len(names))
        # Spent shares from which on limits are lower; infinite: modules have not reported yet.
        self._warm = 1.0 - ((limits.upper / (CONTINUOUS_SHARE * self._continuous)) ** 2 - 1.0) / DERATING_GAIN
        self.limits = limits
        self.lowest: dict[str, float] = {}

    def update(self, thermal: Floats) -> list[tuple[int, str]]:
        """Set the limits by the spent shares (m,) of the budgets, 0 to 1; NaN where nothing new is known.

        Return the modules whose limit has changed by `EVENT_STEP_N`, and the text of each event.
        """
        if self.limits is self._own and not _native.any_reaches(thermal, self._warm):
            return []
        self._thermal = np.where(np.isnan(thermal), self._thermal, np.clip(thermal, 0.0, 1.0))
        left = 1.0 - self._thermal
        stands = CONTINUOUS_SHARE * self._continuous * np.sqrt(1.0 + DERATING_GAIN * left)
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
        for index in np.flatnonzero((np.abs(upper - self._noted) >= EVENT_STEP_N) | whole):
            self._noted[index] = upper[index]
            changed.append((int(index), derating_text(upper[index], self._own.upper[index])))
        return changed

    def require_taut(self, index: int, thermal: float) -> None:
        """Refuse, by a `ModuleFault`, a module whose hot winding cannot hold even its lower limit without end."""
        if thermal >= 1.0 and self._continuous[index] < self._own.lower[index]:
            stands, lower = float(self._continuous[index]), float(self._own.lower[index])
            raise ModuleFault(
                f'module "{self._names[index]}" is too hot: it bears {stands:.2f} N continuously, less than '
                f"its lower limit of {lower:g} N; lower the rig's limit, or let it cool",
                self._names[index],
                Limit.THERMAL,
            )


def derating_text(upper: float, own: float) -> str:
    """Return what a limit is now, in N, as a sentence."""
    if upper >= own:
        return f"pulls with up to {own:g} N again: its winding has cooled"
    return f"pulls with up to {upper:.2f} N in place of {own:g} N, to keep its winding from getting too hot"


TAUT_AFTER_TIMEOUT_S = 2.0  # a module that timed out keeps its cable taut for so long before it releases it


@dataclass(frozen=True)
class Release:
    """Course of a module's tension as it releases its cable."""

    tension: float  # until it begins, in N
    begin: float  # in s
    slew: float  # how fast the tension falls, in N/s
    taut: float = 0.0  # where it stays for `TAUT_AFTER_TIMEOUT_S`, in N; 0: nowhere

    def pull(self, now: float) -> float:
        """Return the tension in N at a time in s."""
        passed = now - self.begin
        if passed <= 0.0:
            return self.tension
        taut = min(self.taut, self.tension)
        if passed > TAUT_AFTER_TIMEOUT_S:
            return max(taut - self.slew * (passed - TAUT_AFTER_TIMEOUT_S), 0.0)
        return max(self.tension - self.slew * passed, taut)


RELEASED = Release(0.0, 0.0, 1.0)


class ReleasedModules:
    """Lost modules, and what each still pulls with as far as is known: no cable goes slack at once.

    `lower` (m,) is of the tension limits in N, `slews` are in N/s, and `ttl` in s is of set-points.
    """

    def __init__(self, lower: Floats, slews: Sequence[float], ttl: float) -> None:
        self._lower, self._slews, self._ttl = lower, slews, ttl
        self._releases: dict[int, Release] = {}

    def add(
        self, index: int, tension: float, heard: float, now: float, state: State | None, error: HardwareError
    ) -> None:
        """Add a lost module: tension of its last set-point in N, time last heard, state it reported, and why."""
        slew, taut = self._slews[index], float(self._lower[index])
        if state in LATCHED_STATES:
            release = RELEASED  # its driver is off
        elif isinstance(error, LinkTimeout) and now - heard > self._ttl:
            # Nobody knows what still reaches it. What it follows lives on from then, and then it times out.
            release = Release(tension, heard + self._ttl, slew, taut)
        elif isinstance(error, LinkError) or state is State.TIMEOUT:
            release = Release(tension, now, slew, taut)  # a link that closes is a time that is out
        else:
            release = Release(tension, now, slew)  # it hears that it is to stop
        self._releases[index] = release

    def pulls(self, now: float) -> Floats:
        """Return the tensions of lost modules at a time in s, (m,) in N; zero for the others."""
        pulls = np.zeros(len(self._lower))
        for index, release in self._releases.items():
            pulls[index] = release.pull(now)
        return pulls
