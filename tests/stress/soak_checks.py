"""Checks of a long run on bad links: limits kept, nothing stale applied, the desired force rendered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tensionlab.hardware.log.reader import Run
from tensionlab.hardware.protocol.codes import Limit, State
from tensionlab.hardware.simulation.simulated_module import Trace
from tensionlab.model.module import TensionLimits
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Integers

ROUNDING = 1e-5  # tensions travel as singles, N


@dataclass(frozen=True)
class Findings:
    """What was seen, and whether it may be.

    Attributes
    ----------
    cycles, compared : int
        Of the run, and those whose force could be compared.
    largest_error, often_error : float
        Of the force that the modules said they pull with, as a share of the demand in force: the largest, and that
        which 99 % stay below.
    outside : int
        Tensions outside the limits, sent or pulled with.
    went_back : int
        Times a module followed an older set-point than one before.
    oldest : float
        Age of the oldest set-point that a module was seen to follow, in s.
    statuses : dict of str to int
    """

    cycles: int
    compared: int
    largest_error: float
    often_error: float
    outside: int
    went_back: int
    oldest: float
    statuses: dict[str, int]

    def problems(self, oldest: float, largest_error: float) -> list[str]:
        """Return what must not be, for a maximum age of set-points (s) and a maximum relative error of forces."""
        wrong = []
        if self.outside:
            wrong.append(f"{self.outside} tensions outside their limits")
        if self.went_back:
            wrong.append(f"{self.went_back} times a module went back to an older set-point")
        if self.oldest > oldest:
            wrong.append(f"a set-point of {self.oldest:.3f} s was still followed; at most {oldest:g} s are right")
        if not self.largest_error <= largest_error:
            wrong.append(f"the force was off by {100 * self.largest_error:.1f} % of the demand")
        if not self.compared:
            wrong.append("no cycle could be compared")
        return wrong


def examine(run: Run, outside: int = 0) -> Findings:
    """Return the findings of a run.

    The force is that of the tensions which the modules said they pull with, at the pose by their cable lengths,
    against the demand at the time the latest of their set-points was sent, where that was exact. Left out are
    cycles in which a module says that something limits it, or the host held the set-points back: they are on
    their way to a demand that has leapt.

    Parameters
    ----------
    run : Run
    outside : int
        Tensions outside the limits that modules were seen to pull with.
    """
    source = followed(run)
    known = (source >= 0).all(axis=1)
    free = (run.limiters == Limit.NONE) | (run.limiters == Limit.LOWER)
    rows = np.flatnonzero(known & free.all(axis=1))
    latest = source[rows].max(axis=1)
    whole = (run.commanded[latest] == run.chosen[latest]).all(axis=1)
    exact = (run.status[latest] == Status.EXACT) & whole
    rows, latest = rows[exact], latest[exact]
    pulled = np.einsum("knm,km->kn", run.structure[rows], run.measured[rows])
    wanted = run.demanded[latest]
    errors = np.linalg.norm(pulled - wanted, axis=1) / np.linalg.norm(wanted, axis=1)
    sent = run.commanded[np.isfinite(run.commanded)]
    lower, upper = run.rig.limits.lower, run.rig.limits.upper
    outside += int(((run.commanded < lower) | (run.commanded > upper)).sum())
    ages = (run.time[:, None] - run.time[source] - run.ages)[known]
    return Findings(
        cycles=len(run),
        compared=len(rows),
        largest_error=float(errors.max(initial=0.0)) if sent.size else np.nan,
        often_error=float(np.percentile(errors, 99.0)) if errors.size else np.nan,
        outside=outside,
        went_back=int((np.diff(source[known], axis=0) < 0).sum()),
        oldest=float(ages.max(initial=0.0)),
        statuses={status.name: int((run.status == status).sum()) for status in Status},
    )


def followed(run: Run) -> Integers:
    """Return the cycle in which the set-point was sent that each module followed, by its telemetry.

    Returns
    -------
    (K, m) array
        Row of the run; -1 before the first one that a module followed.
    """
    found: Integers = np.full(run.last_sequence.shape, -1, dtype=np.int64)
    for module in range(run.rig.m):
        last = np.full(256, -1, dtype=np.int64)
        for row in range(len(run)):
            if run.last_sequence[row, module] >= 0:
                found[row, module] = last[run.last_sequence[row, module]]
            last[run.sequences[row, module]] = row
    return found


class LimitWatch:
    """Watch of a world that counts how often a running module leaves its limits, from above 0 N when it begins."""

    def __init__(self, limits: TensionLimits) -> None:
        self._lower, self._upper = limits.lower - ROUNDING, limits.upper + ROUNDING
        self._taut = np.zeros(limits.lower.size, dtype=bool)
        self.outside = 0

    def __call__(self, traces: Sequence[Trace]) -> None:
        """Count in the latest steps of all modules."""
        for index, trace in enumerate(traces):
            running = trace.state == State.RUNNING
            taut = running & (trace.commanded >= self._lower[index])
            before = np.concatenate(([self._taut[index]], taut[:-1]))
            slackened = before & running & ~taut
            self.outside += int((slackened | (running & (trace.commanded > self._upper[index]))).sum())
            self._taut[index] = taut[-1]
