"""Guard of the set-points of a run.

Only certified answers are sent (`GuardedAllocator`), lower where a winding is warm (`Derating`), and less the
friction that adds to them (`FrictionCompensation`). Cables of lost modules are released slowly (`Release`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.allocation import Allocation, Allocator, Policy, Solver, Status, resolve_solver
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.protocol.codes import LATCHED_STATES, Limit, State
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

CERTIFIED = frozenset((int(Status.EXACT), int(Status.NEAREST)))
MAX_PREPARED = 256  # number of sets of limits that are kept prepared: windings warm and cool step by step
EXACT_SOLVER = "newton"  # fallback where the chosen solver leaves its answer unproven


# Takes structure matrix, wrench, the modules that are free (m,) and the limits of all.
AllocateFree = Callable[[Floats, Floats, NDArray[np.bool_], TensionLimits], tuple[Allocation, bool]]


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


# Share of the tension that a module reports to bear which the host uses: currents are measured with some noise.
BEARABLE_SHARE = 0.98
STEP_N = 0.05  # limits change by whole steps, too small to be noticed; solvers are prepared for each set of limits


class Derating:
    """Upper tension limits of all modules, by the tensions that warm windings and drivers bear.

    A module reports a little less than it limits at itself, so the host limits first, late telemetry or not.
    `limits` are the present ones, `lowest` the lowest so far, in N, of each module that was derated.
    """

    def __init__(self, limits: TensionLimits, names: list[str]) -> None:
        self._own, self._names, self.lower = limits, names, limits.lower
        self._bearable = np.full(len(names), np.inf)
        self._enough = limits.upper / BEARABLE_SHARE
        self.limits = limits
        self.lowest: dict[str, float] = {}

    def update(self, bearable: Floats) -> None:
        """Set the limits by what modules bear now (m,) in N; NaN where nothing new is known."""
        own = self._own
        if self.limits is own and not _native.any_exceeds(self._enough, bearable):
            return
        self._bearable = np.where(np.isnan(bearable), self._bearable, bearable)
        upper = np.clip(STEP_N * np.floor(BEARABLE_SHARE * self._bearable / STEP_N), own.lower, own.upper)
        if (upper == self.limits.upper).all():
            return
        self.limits = TensionLimits(own.lower, upper)
        for index in np.flatnonzero(upper < own.upper):
            name, limit = self._names[index], float(upper[index])
            self.lowest[name] = min(limit, self.lowest.get(name, limit))

    def require_holding(self, index: int, bearable: float) -> None:
        """Refuse, by a `ModuleFault`, a module that is too hot to bear even its lower limit."""
        lower = self.lower[index]
        if bearable < lower:
            name, limit = self._names[index], f"its lower limit of {lower:g} N"
            hot = f'module "{name}" is too hot: it bears {bearable:.2f} N, less than {limit}; let it cool'
            raise ModuleFault(hot, name, Limit.THERMAL)


# Speed of a cable below which its friction is not compensated, in m/s; from twice that speed on all of it is. At
# rest a compensated friction would change sides with the noise of the speed, and shake the hand.
FRICTION_DEAD_BAND_M_S = 0.01


class FrictionCompensation:
    """Friction of winches and pulleys that the runner compensates by the sign of the measured speed.

    It is that of the rig's modules, less what each compensates itself by its parameters ``friction_coulomb`` and
    ``friction_viscous``, in N and N s/m. See Armstrong-Hélouvry et al. 1994, Automatica 30(7).
    """

    def __init__(self, rig: Rig, compensated: Sequence[Sequence[float]]) -> None:
        known = [(module.friction_coulomb or 0.0, module.friction_viscous or 0.0) for module in rig.modules]
        self._coulomb, self._viscous = np.maximum(np.array(known) - np.array(compensated), 0.0).T

    def force(self, speeds: Floats) -> Floats:
        """Return the friction (m,) in N that adds to the tensions of cables with these speeds of paying out."""
        share = np.clip(np.abs(speeds) / FRICTION_DEAD_BAND_M_S - 1.0, 0.0, 1.0)
        force: Floats = np.nan_to_num(share * (np.sign(speeds) * self._coulomb + self._viscous * speeds))
        return force


HOLD_AFTER_TIMEOUT_S = 2.0  # time for which a module that timed out keeps its cable taut before it releases it


class Release(NamedTuple):
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


def release_of(
    error: HardwareError,
    state: State | None,
    tension: float,
    taut: float,
    slew: float,
    *,
    now: float,
    expired: float,
) -> Release:
    """Return how a module that is lost by an error releases its cable: no cable goes slack at once.

    Its last set-point was `tension`, its lower limit is `taut`, both in N; `slew` is in N/s. The set-point has
    `expired` at that time in s if the module has not heard another since it was last heard.
    """
    if state in LATCHED_STATES:
        return Release(0.0, now, slew)  # its driver is off
    if isinstance(error, LinkTimeout) and now > expired:
        return Release(tension, expired, slew, taut)
    if isinstance(error, LinkError) or state is State.TIMEOUT:
        return Release(tension, now, slew, taut)  # a link that closes times out at once
    return Release(tension, now, slew)  # it hears that it is to stop
