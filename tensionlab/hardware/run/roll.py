"""Which modules take part in a run, and which have dropped out?"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tensionlab.demand import Demand, Floats, Integers
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.codes import State
from tensionlab.hardware.group import ModuleGroup
from tensionlab.hardware.module import ModuleClient
from tensionlab.hardware.protocol import SetImpedance, Stop
from tensionlab.hardware.run.derating import Derating
from tensionlab.hardware.run.observe import Observation

OnLoss = Literal["stop", "continue"]
ON_LOSS: tuple[OnLoss, ...] = get_args(OnLoss)
"""What to do when a module drops out: end the run, or go on with the others."""


class Roll:
    """Who takes part, who is looked after each cycle, and who is sent set-points.

    Parameters
    ----------
    group : ModuleGroup
    silence : float
        A module that has said nothing for so long, in s, has dropped out.
    on_loss : {"stop", "continue"}
    told : callable
        Hears the index and the error of each module that drops out.

    Attributes
    ----------
    active : (m,) array of bool
        Modules that take part. One that dropped out does not come back.
    """

    def __init__(
        self, group: ModuleGroup, silence: float, on_loss: OnLoss, told: Callable[[int, HardwareError], None]
    ) -> None:
        self.active: NDArray[np.bool_] = np.ones(len(group.clients), dtype=bool)
        self._clients, self._silence, self._on_loss, self._told = group.clients, silence, on_loss, told

    def call(self, seen: Observation, derating: Derating) -> None:
        """Look whether all are well, by what they said last and how long ago.

        Raises
        ------
        HardwareError
            One is not, and the run is to stop; or none is left.
        """
        for index, client in enumerate(self._clients):
            if self.active[index]:
                try:
                    require_well(client, float(seen.ages[index]), self._silence)
                    derating.require_taut(index, float(seen.thermal[index]))
                except HardwareError as error:
                    self._lose(index, error)

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
        self._told(index, error)
        if self._on_loss == "stop":
            raise error
        with suppress(HardwareError):
            self._clients[index].post(Stop())
        if not self.active.any():
            raise HardwareError(f"no module is left; the last one: {error}")


def require_well(client: ModuleClient, age: float, silence: float) -> None:
    """Refuse a module that no longer follows set-points.

    Raises
    ------
    ModuleFault, LinkError, LinkTimeout
        It has let go, refused a set-point, was stopped by somebody else or started anew; its link broke; it has
        said nothing for ``silence`` s.
    """
    client.check()
    if client.state not in (State.ARMED, State.RUNNING):
        state = State.IDLE if client.state is None else client.state
        raise ModuleFault(
            f'module "{client.name}" is {state.name}: somebody else stopped it, or it started anew',
            client.name,
            state,
        )
    if age > silence:
        raise LinkTimeout(f'module "{client.name}" at {client.link.url} has been silent for {age:.2f} s')
