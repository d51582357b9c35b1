"""Checks of the modules in each cycle of a run, and what lost ones still pull with."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats, Integers
from tensionlab.demand import Demand
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.client.connection import Received
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import LATCHED_STATES, State
from tensionlab.hardware.protocol.messages import SetImpedance, Stop, Telemetry
from tensionlab.hardware.runner.guard import Derating
from tensionlab.hardware.runner.observation import LoopChecks, Observation, require_plausible
from tensionlab.hardware.runner.settings import OnLoss

STALL = 0.75
"""A run whose next cycle is longer in coming than this share of the time to live has stalled."""


class Roll:
    """Who takes part, who is looked after each cycle, and who is sent set-points.

    Parameters
    ----------
    group : ModuleGroup
    ttl : float
        Time to live of set-points, in s: a module that has said nothing for so long has dropped out.
    on_loss : {"stop", "continue"}
    on_lost : callable
        Hears the index and the error of each module that drops out.

    Attributes
    ----------
    active : (m,) array of bool
        Modules that take part. One that dropped out does not come back.
    """

    def __init__(
        self, group: ModuleGroup, ttl: float, on_loss: OnLoss, on_lost: Callable[[int, HardwareError], None]
    ) -> None:
        self.active: NDArray[np.bool_] = np.ones(len(group.clients), dtype=bool)
        self._clients, self._ttl, self._on_loss, self._on_lost = group.clients, ttl, on_loss, on_lost
        self._heard: list[Received[Telemetry] | None] = [None] * len(group.clients)
        self._loops = LoopChecks([client.name for client in group.clients], ttl)
        self._stall = Stall(ttl)

    def call(self, seen: Observation, delays: Floats, derating: Derating, now: float) -> None:
        """Look whether all are well, by what they said last and how long ago.

        Parameters
        ----------
        seen : Observation
        delays : (m,) array
            How old the newest set-points are that modules report to follow, in s.
        derating : Derating
        now : float
            Time, in s.

        Raises
        ------
        HardwareError
            One is not, and the run is to stop; or none is left.
        """
        self._stall.update(now)
        self._loops.update(delays, now)
        for index, client in enumerate(self._clients):
            if self.active[index]:
                try:
                    self._require_well(index, client, float(seen.ages[index]))
                    derating.require_taut(index, float(seen.thermal[index]))
                except HardwareError as error:
                    self._lose(index, error)

    def _require_well(self, index: int, client: ModuleClient, age: float) -> None:
        try:
            require_following(client)
        except ModuleFault as fault:
            if fault.code is State.TIMEOUT and self._stall.seconds:
                raise ModuleFault(f"{fault}: {self._stall}", fault.module, fault.code) from None
            raise
        if client.telemetry is not None and client.telemetry is not self._heard[index]:
            before, self._heard[index] = self._heard[index], client.telemetry
            require_plausible(client.name, before, client.telemetry)
        if age > self._ttl + self._stall.seconds:
            raise LinkTimeout(f'module "{client.name}" at {client.link.url} {silence(client, age)}')
        if not self._stall.seconds:
            self._loops.require_prompt(index)

    def send(self, tensions: Floats, demand: Demand, ttl_ms: int) -> Integers:
        """Send set-points to those that take part: tensions in N, NaN where an impedance is demanded.

        Returns
        -------
        (m,) array
            Their sequence numbers; -1 where none was sent.
        """
        sequences: Integers = np.full(len(self._clients), -1, dtype=np.int64)
        for index, client in enumerate(self._clients):
            if not self.active[index]:
                continue
            brake = client.name in demand.brakes
            try:
                if client.name in demand.impedances:
                    spring = vars(demand.impedances[client.name])
                    sequences[index] = client.set_impedance(SetImpedance(0, **spring, brake=brake, ttl_ms=ttl_ms))
                else:
                    sequences[index] = client.set_tension(float(tensions[index]), brake=brake, ttl_ms=ttl_ms)
            except LinkError as error:
                self._lose(index, error)
        return sequences

    def _lose(self, index: int, error: HardwareError) -> None:
        self.active[index] = False
        self._on_lost(index, error)
        if self._on_loss == "stop":
            raise error
        with suppress(HardwareError):
            self._clients[index].send(Stop())
        if not self.active.any():
            raise HardwareError(f"no module is left; the last one: {error}")


class Stall:
    """A cycle that came late, by a busy computer or a slow solver: what modules miss by it is not their fault.

    Parameters
    ----------
    ttl : float
        Time to live of set-points, in s. After a stall, modules have as long to be heard again.

    Attributes
    ----------
    seconds : float
        How long the latest one lasted; 0 if it was long ago, or there was none.
    """

    def __init__(self, ttl: float) -> None:
        self._ttl, self._before, self._until = ttl, math.inf, -math.inf
        self.seconds = 0.0

    def update(self, now: float) -> None:
        """Note that the run got its turn at a time in s."""
        gap = now - self._before
        self._before = now
        if gap > STALL * self._ttl:
            self.seconds, self._until = gap, now + self._ttl
        elif now > self._until:
            self.seconds = 0.0

    def __str__(self) -> str:
        return (
            f"this computer took {self.seconds:.2f} s from one cycle to the next, and set-points live "
            f"{self._ttl:g} s; is it busy, or the solver slow?"
        )


def require_following(client: ModuleClient) -> None:
    """Refuse a module that no longer follows set-points.

    Raises
    ------
    ModuleFault, LinkError
        It has let go, refused a set-point, was stopped by somebody else or started anew; its link broke.
    """
    client.check()
    late = client.state is State.IDLE and not client.reports_since_arm  # what it was before; see `LoopChecks`
    if client.state not in (State.ARMED, State.RUNNING) and not late:
        state = State.IDLE if client.state is None else client.state
        raise ModuleFault(
            f'module "{client.name}" is {state.name}: somebody else stopped it, or it started anew',
            client.name,
            state,
        )


def silence(client: ModuleClient, age: float) -> str:
    """Say for how long a module has said nothing new, in s."""
    if client.repeated and client.telemetry is not None:
        return (
            f"repeats what it said {age:.2f} s ago ({client.repeated} times time_us "
            f"{client.telemetry.message.time_us}): its firmware or its link hangs; switch it off and on"
        )
    return f"has been silent for {age:.2f} s"


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
