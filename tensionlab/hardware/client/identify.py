"""Which of the modules is this one? Its cable pulses, gently."""

from __future__ import annotations

import time
from collections.abc import Callable

from tensionlab.errors import HardwareError, ModuleFault
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Code, State
from tensionlab.hardware.protocol.messages import Info

PULSES = 3
STRENGTH = 0.5
"""Above the taut minimum, in N."""
LASTING = 0.4
"""Of each pulse and of each pause, in s."""
AGAIN = 0.05
"""How often a set-point is sent, in s."""


def identify(client: ModuleClient, begun: Callable[[], None]) -> None:
    """Which module is this? It is armed, its cable pulses three times, and it is stopped.

    Parameters
    ----------
    client : ModuleClient
    begun : callable
        Told when it is armed, and begins.

    Raises
    ------
    HardwareError
        It is armed already, by somebody else; it has let go and was not cleared; it is not calibrated; something
        is wrong with it. Or it lets go meanwhile, or its link breaks.
    """
    info = client.hello()
    _require_idle(client, info)
    client.stop()  # one that timed out in an earlier run is still in it
    strong = min(info.tension_lower + STRENGTH, info.tension_upper)
    try:
        client.arm()
    except ModuleFault as fault:
        if fault.code is not Code.FAULT_PRESENT:
            raise
        advice = f"something is wrong with it, see `tensionlab module monitor {client.link.url}`"
        raise ModuleFault(f"{fault}; {advice}", fault.module, fault.code) from None
    try:
        begun()
        for _ in range(PULSES):
            _pull(client, info.tension_lower)
            _pull(client, strong)
    finally:
        client.stop()


def _require_idle(client: ModuleClient, info: Info) -> None:
    if info.state in (State.ARMED, State.RUNNING):
        raise HardwareError(
            f'module "{client.name}" is {info.state.name}: somebody else has it armed; stop it there, or with '
            f"`tensionlab module stop {client.link.url}`"
        )
    client.require_cleared(info)
    if not info.calibrated:
        raise HardwareError(
            f'module "{client.name}" is not calibrated, and can\'t be armed: '
            f"`tensionlab module calibrate gain {client.link.url}`"
        )


def _pull(client: ModuleClient, tension: float) -> None:
    end = client.link.clock() + LASTING
    while client.link.clock() < end:
        client.set_tension(tension)
        client.listen(AGAIN)
        if not client.link.lockstep:
            time.sleep(AGAIN)
        client.check()
