"""Records that a run hands to its sinks: cycles, events, and its outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from tensionlab.allocation import Allocation
from tensionlab.demand import Demand, RigState
from tensionlab.hardware.protocol.messages import Info
from tensionlab.hardware.runner.statistics import Statistics
from tensionlab.support.arrays import Floats, Integers


@dataclass(frozen=True, eq=False)
class Cycle:
    """One cycle of a run.

    Attributes
    ----------
    state : RigState
        At its begin.
    demand : Demand
        Its wrench with what the rig requires.
    solver_wrench : (n,) array
        What of the desired wrench the solver is to render: all but what modules with an impedance, and lost ones
        that have not released yet, pull.
    allocation : Allocation
        What the solver chose, verified; with tension 0 in modules that do not take part.
    fallback_used : bool
        Whether the run's own solver left the answer unproven, so that the exact solver gave this one.
    commanded : (m,) array
        Set-points in N, after the limit on their change; NaN where none was sent.
    sequences : (m,) array of int
        Their sequence numbers; -1 where none was sent.
    start_delay : float
        How long after its deadline the cycle began, in s.
    compute_time : float
        What the host needed for it, in s.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> from tensionlab.hardware import Demand, Runner, World, WorldClock
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> world, pull = World(rig), Demand(np.array([0.0, 0.0, 1.5]))
    >>> runner = Runner(rig, world.group(), "newton", lambda state: pull, clock=WorldClock(world))
    >>> _ = runner.run(seconds=1.0)
    >>> runner.latest.commanded.round(1)
    array([1.5, 2.5, 0.5, 2. ])
    """

    state: RigState
    demand: Demand
    solver_wrench: Floats
    allocation: Allocation
    fallback_used: bool
    commanded: Floats
    sequences: Integers
    start_delay: float
    compute_time: float


@dataclass(frozen=True)
class RunEvent:
    """Event in a run."""

    cycle: int  # number of the latest cycle; -1 before the first
    time: float  # begin of that cycle, in s since the run began
    kind: str  # in a word
    text: str  # in a sentence
    module: str = ""  # name of the module; empty where it is none, or all


class RunSink(Protocol):
    """Sink for all that happens in a run, such as `RunLog`. A `HardwareError` of it ends the run."""

    def begin(self, infos: Mapping[str, Info], statistics: Statistics) -> None:
        """Take the description of each module, by its name, and the statistics, which grow during the run."""

    def write(self, cycle: Cycle) -> None:
        """Take a cycle. Its arrays do not change any more."""

    def note(self, event: RunEvent) -> None:
        """Take an event; from any thread."""

    def close(self, statistics: Statistics) -> None:
        """Take how the run went; nothing comes after that."""
