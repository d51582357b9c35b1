"""Guard of the set-points of a run.

Only certified answers are sent (`GuardedAllocator`), inside limits and slew (`next_tensions`; the check itself is
in ``tensionlab/native/hardware/set_points.hpp``), and lower where a winding is warm (`Derating`). Cables of lost
modules are released slowly (`ReleasedModules`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.allocation import Allocation, Allocator, Policy, Solver, Status, resolve_solver
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.protocol.codes import LATCHED_STATES, Limit, State
from tensionlab.model.module import TensionLimits
from tensionlab.support.arrays import Floats

CERTIFIED = frozenset((int(Status.EXACT), int(Status.NEAREST)))
MAX_PREPARED = 256  # number of sets of limits that are kept prepared: windings warm and cool step by step
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
        key = part.tobytes() + limits.upper.tobytes()
        if key not in self._prepared:
            if len(self._prepared) >= MAX_PREPARED:
                self._prepared.clear()
            limits = limits.only(part)
            chosen = Allocator(limits, self._solver, policy=self._policy)
            self._prepared[key] = chosen, Allocator(limits, EXACT_SOLVER, policy=chosen.policy)
        chosen, exact = self._prepared[key]
        allocation = chosen(structure, wrench)
        if int(allocation.status) in CERTIFIED:
            return allocation, False
        return exact(structure, wrench), True


def next_tensions(
    before: Floats,
    chosen: Floats,
    free: NDArray[np.bool_],
    limits: TensionLimits,
    max_change: float,
    names: Sequence[str],
) -> tuple[Floats, Floats, bool]:
    """Return the next tensions (m,), those that are commanded (NaN elsewhere), and whether slew limits them.

    The `free` (m,) go from those `before` to those `chosen`, by the same share of their way each, so that the
    wrench goes straight from the old to the new one; none changes by more than `max_change` N. A `HardwareError`
    names the module whose set-point would be outside its limits, NaN among that.
    """
    tensions, commanded, slew_limited, refused = _native.next_tensions(
        before, chosen, free, limits.lower, limits.upper, max_change
    )
    if refused >= 0:
        raise HardwareError(
            f'module "{names[refused]}" would be sent {chosen[refused]:g} N; its limits are '
            f"{limits.lower[refused]:g} to {limits.upper[refused]:g} N"
        )
    return tensions, commanded, slew_limited


# Share of a winding's continuous rating that the host uses: currents are measured with some noise.
CONTINUOUS_SHARE = 0.98
# Gain from the remaining budget of a winding to the square of the current that the host commands. The firmware
# limits at 10 (`firmware/core/thermal.hpp`); with less, the host limits first, late telemetry or not.
DERATING_GAIN = 8.0
STEP_N = 0.05  # limits change by whole steps, too small to be noticed; solvers are prepared for each set of limits
EVENT_STEP_N = 0.5  # a change of a limit by this much is an event


class Derating:
    """Upper tension limits of all modules, by the spent share of each winding's budget.

    From cold to spent a limit falls from the rig's own to the winding's continuous tension (m,) in N, without a
    jump. `limits` are the present ones. `lowest` has the lowest limit so far, in N, of each module that was below
    the rig's.
    """

    def __init__(self, limits: TensionLimits, continuous: Floats, names: list[str]) -> None:
        self._own, self._continuous, self._names = limits, continuous, names
        self._noted = limits.upper.copy()
        self._thermal = np.zeros(len(names))
        # Spent shares from which on limits are lower.
        self._warm = 1.0 - ((limits.upper / (CONTINUOUS_SHARE * continuous)) ** 2 - 1.0) / DERATING_GAIN
        self.limits = limits
        self.lowest: dict[str, float] = {}

    def update(self, thermal: Floats) -> list[tuple[int, str]]:
        """Set the limits by the spent shares (m,) of the budgets, 0 to 1; NaN where nothing new is known.

        Return the modules whose limit has changed by `EVENT_STEP_N`, and the text of each event.
        """
        if self.limits is self._own and not _native.any_exceeds(thermal, self._warm):
            return []
        self._thermal = np.where(np.isnan(thermal), self._thermal, np.clip(thermal, 0.0, 1.0))
        bearable = CONTINUOUS_SHARE * self._continuous * np.sqrt(1.0 + DERATING_GAIN * (1.0 - self._thermal))
        upper = np.minimum(STEP_N * np.floor(bearable / STEP_N), self._own.upper)
        upper = np.maximum(upper, self._own.lower)
        if (upper == self.limits.upper).all():
            return []
        self.limits = TensionLimits(self._own.lower, upper)
        for index in np.flatnonzero(upper < self._own.upper):
            name = self._names[index]
            self.lowest[name] = min(float(upper[index]), self.lowest.get(name, np.inf))
        restored = (upper == self._own.upper) & (self._noted < self._own.upper)
        changed = np.flatnonzero((np.abs(upper - self._noted) >= EVENT_STEP_N) | restored)
        self._noted[changed] = upper[changed]
        return [(int(index), _derating_text(upper[index], self._own.upper[index])) for index in changed]

    def require_holding(self, index: int, thermal: float) -> None:
        """Refuse, by a `ModuleFault`, a module whose hot winding cannot hold even its lower limit continuously."""
        if thermal >= 1.0 and self._continuous[index] < self._own.lower[index]:
            bearable, lower = self._continuous[index], self._own.lower[index]
            raise ModuleFault(
                f'module "{self._names[index]}" is too hot: it bears {bearable:.2f} N continuously, less than '
                f"its lower limit of {lower:g} N; lower the rig's limit, or let it cool",
                self._names[index],
                Limit.THERMAL,
            )


def _derating_text(upper: float, own: float) -> str:
    if upper >= own:
        return f"pulls with up to {own:g} N again: its winding has cooled"
    return f"pulls with up to {upper:.2f} N in place of {own:g} N, to keep its winding from getting too hot"


HOLD_AFTER_TIMEOUT_S = 2.0  # time for which a module that timed out keeps its cable taut before it releases it


@dataclass(frozen=True)
class Release:
    """Course of a module's tension as it releases its cable."""

    tension: float  # until it begins, in N
    begin: float  # in s
    slew: float  # rate at which the tension falls, in N/s
    hold: float = 0.0  # tension in N that is held for `HOLD_AFTER_TIMEOUT_S`; 0: none

    def pull(self, now: float) -> float:
        """Return the tension in N at a time in s."""
        passed = now - self.begin
        if passed <= 0.0:
            return self.tension
        hold = min(self.hold, self.tension)
        if passed > HOLD_AFTER_TIMEOUT_S:
            return max(hold - self.slew * (passed - HOLD_AFTER_TIMEOUT_S), 0.0)
        return max(self.tension - self.slew * passed, hold)


class ReleasedModules:
    """Lost modules, and the tension of each as far as it is known: no cable goes slack at once.

    `lower` (m,) is of the tension limits in N, `slews` are in N/s, and `ttl` in s is of set-points.
    """

    def __init__(self, lower: Floats, slews: Sequence[float], ttl: float) -> None:
        self._lower, self._slews, self._ttl = lower, slews, ttl
        self._releases: dict[int, Release] = {}

    def add(
        self, index: int, tension: float, last_heard: float, now: float, state: State | None, error: HardwareError
    ) -> None:
        """Add a lost module: tension of its last set-point in N, time last heard, state it reported, and why."""
        slew, hold = self._slews[index], float(self._lower[index])
        if state in LATCHED_STATES:
            release = Release(0.0, now, slew)  # its driver is off
        elif isinstance(error, LinkTimeout) and now - last_heard > self._ttl:
            # It may hear nothing any more. Then its last set-point expires a time to live after it was last heard.
            release = Release(tension, last_heard + self._ttl, slew, hold)
        elif isinstance(error, LinkError) or state is State.TIMEOUT:
            release = Release(tension, now, slew, hold)  # a link that closes times out at once
        else:
            release = Release(tension, now, slew)  # it hears that it is to stop
        self._releases[index] = release

    def pulls(self, now: float) -> Floats:
        """Return the tensions of lost modules at a time in s, (m,) in N; zero for the others."""
        pulls = np.zeros(len(self._lower))
        for index, release in self._releases.items():
            pulls[index] = release.pull(now)
        return pulls
