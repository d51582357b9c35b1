"""All modules of a rig: opened, armed and stopped together."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault
from tensionlab.hardware.codes import State
from tensionlab.hardware.link import Link
from tensionlab.hardware.module import TRIES, ModuleClient
from tensionlab.hardware.protocol import Arm, EmergencyStop, Info, Message, Stop
from tensionlab.model.rig import Rig

BREATH = 2e-3
"""How long to wait, in s, before looking again whether an answer has come."""
KEPT_ALIVE = 0.04
"""How often, in s, a module that is armed already hears that it is to stay so while others are being armed."""
LET_GO = (State.FAULT, State.ESTOP)
"""States in which a module has its driver off, and takes no STOP."""
SLACK = 1e-6
"""Share by which a limit may seem exceeded: the module has it as a single."""


class ModuleGroup:
    """Clients of all modules of a rig, in its order.

    Parameters
    ----------
    clients : sequence of ModuleClient
        One for each module.

    Attributes
    ----------
    infos : tuple of Info
        What the modules said of themselves; empty before `prepare`.
    slews : tuple of float
        How fast each lets its tension change, in N/s; empty before `prepare`.
    """

    def __init__(self, clients: Sequence[ModuleClient]) -> None:
        self.clients = tuple(clients)
        self.infos: tuple[Info, ...] = ()
        self.slews: tuple[float, ...] = ()

    def prepare(self, rig: Rig, telemetry_ms: int) -> None:
        """Make sure that these modules can do what the rig says, and have them report.

        Raises
        ------
        HardwareError
            Naming the module: it is in use, has a fault, is not calibrated, or has other limits than the rig.
        """
        self.infos = tuple(client.hello() for client in self.clients)
        for client, info, module in zip(self.clients, self.infos, rig.modules, strict=True):
            if info.state in (State.ARMED, State.RUNNING):
                raise LinkError(f'module "{client.name}" at {client.link.url} is in use: somebody has it armed')
            if info.state in LET_GO:
                raise ModuleFault(
                    f'module "{client.name}" is in {info.state.name}: find out why, then '
                    f"`tensionlab module clear {client.link.url}`",
                    client.name,
                    info.state,
                )
            if not info.calibrated:
                raise HardwareError(
                    f'module "{client.name}" is not calibrated: '
                    f"`tensionlab module calibrate gain {client.link.url}`"
                )
            lower, upper = info.tension_lower * (1.0 - SLACK), info.tension_upper * (1.0 + SLACK)
            if not lower <= module.lower <= module.upper <= upper:
                raise HardwareError(
                    f'module "{client.name}" pulls with {info.tension_lower:g} to {info.tension_upper:g} N, but '
                    f"the rig wants {module.lower:g} to {module.upper:g} N; change the rig's limits, or the "
                    f"module's parameters tension_lower and tension_upper"
                )
            if info.state is State.TIMEOUT:
                client.stop()
            client.telemetry_every(telemetry_ms)
        self.slews = tuple(client.parameter("slew") for client in self.clients)

    def require_lengths(self) -> None:
        """Make sure that all know how long their cable is; a `HardwareError` names those that do not."""
        unknown = [
            client.name for client, info in zip(self.clients, self.infos, strict=True) if not info.length_known
        ]
        if unknown:
            raise HardwareError(
                f"the cable lengths of {', '.join(unknown)} are not known, so neither is the position: calibrate "
                "them (`tensionlab module calibrate lengths`), or give a tracker or a place"
            )

    def arm(self, tensions: Iterable[float]) -> None:
        """Have all modules pull with the taut minimum; those armed first are kept alive meanwhile.

        Raises
        ------
        ModuleFault, LinkTimeout, LinkError
            A module refuses, or does not answer. Those that are armed by then stay so: `stop` them.
        """
        taut = dict(zip(self.clients, tensions, strict=True))
        commands = {}
        for client in self.clients:
            client.begin_session()
            commands[client] = Arm(client.session)
        waiting = {client: client.post(command) for client, command in commands.items()}
        for timeout in TRIES:
            end, again = time.monotonic() + timeout, 0.0
            while waiting and time.monotonic() < end:
                for client, sequence in list(waiting.items()):
                    client.listen()
                    if client.answer(commands[client], sequence) is not None:
                        del waiting[client]
                if time.monotonic() >= again:
                    again = time.monotonic() + KEPT_ALIVE
                    for client in self.clients:
                        if client not in waiting:
                            client.set_tension(taut[client])
                if waiting:
                    self._breathe()
            for client, sequence in waiting.items():
                client.post(commands[client], sequence)
        if waiting:
            listed = ", ".join(f'"{client.name}"' for client in waiting)
            raise LinkTimeout(f"modules that did not answer ARM in {len(TRIES)} tries: {listed}; are they on?")

    def stop(self) -> dict[str, HardwareError]:
        """Have all modules let go: all are told before any is waited for. Which did not confirm it, and why?"""
        return self._all_at_once(Stop())

    def emergency_stop(self) -> dict[str, HardwareError]:
        """Have all modules let go at once, and stay so. Which did not confirm it, and why?"""
        return self._all_at_once(EmergencyStop())

    def close(self) -> None:
        """Close all links. Modules that are still pulling notice, and let go by themselves."""
        for client in self.clients:
            with suppress(HardwareError):
                client.close()

    def _all_at_once(self, command: Message) -> dict[str, HardwareError]:
        for client in self.clients:
            with suppress(HardwareError):
                client.post(command)
        failed: dict[str, HardwareError] = {}
        for client in self.clients:
            try:
                client.tell(command)
            except ModuleFault as fault:
                if client.state not in LET_GO:
                    failed[client.name] = fault
            except HardwareError as error:
                failed[client.name] = error
        return failed

    def _breathe(self) -> None:
        """Let time pass: here, and in simulated modules of this process."""
        for client in self.clients:
            client.listen(BREATH)
        time.sleep(BREATH)


def connect(rig: Rig, links: Mapping[str, str | Link]) -> ModuleGroup:
    """Reach all modules of a rig.

    Parameters
    ----------
    rig : Rig
    links : mapping of str to str or Link
        For each module, by its name, the URL of its link, or a link that is open.

    Raises
    ------
    LinkError
        A link cannot be opened; those that could be are closed again.
    HardwareError
        Names that are not those of the rig's modules.
    """
    names = [module.name for module in rig.modules]
    for name in links:
        if name not in names:
            raise HardwareError(f'rig "{rig.name}" has no module "{name}"; it has {", ".join(names)}')
    missing = [name for name in names if name not in links]
    if missing:
        raise HardwareError(f'rig "{rig.name}": no link for {", ".join(missing)}; give each module its own')

    def reach(name: str) -> ModuleClient | HardwareError:
        try:
            return ModuleClient(name, links[name])
        except HardwareError as error:
            return error

    with ThreadPoolExecutor(len(names)) as threads:  # Bluetooth takes seconds for each
        reached = list(threads.map(reach, names))
    clients = [each for each in reached if isinstance(each, ModuleClient)]
    for each in reached:
        if isinstance(each, HardwareError):
            ModuleGroup(clients).close()
            raise each
    return ModuleGroup(clients)
