"""All modules of a rig: opened, armed and stopped together."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

from tensionlab.errors import HardwareError, LinkError, ModuleFault
from tensionlab.hardware.client.connection import ANSWER_TIMEOUTS_S, AnswerType
from tensionlab.hardware.client.links import Link
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import LATCHED_STATES, State
from tensionlab.hardware.protocol.messages import (
    Acknowledge,
    Arm,
    ConfigureTelemetry,
    EmergencyStop,
    GetParameter,
    Hello,
    Info,
    Message,
    ParameterValue,
    Stop,
)
from tensionlab.hardware.protocol.parameters import PARAMETERS
from tensionlab.model.rig import Rig

PATIENT_TIMEOUTS_S = (*ANSWER_TIMEOUTS_S, *(ANSWER_TIMEOUTS_S[-1],) * 5)
"""How long each try waits for an answer, in s. They are more than the protocol's: a bad link is no reason to give
up before a run, and less so at its end."""
BREATH = 2e-3
"""How long to wait, in s, before looking again whether an answer has come."""
KEPT_ALIVE = 0.04
"""How often, in s, a module that is armed already hears that it is to stay so while others are being armed."""
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
    continuous : tuple of float
        What each winding stands for ever, in N; empty before `prepare`.
    """

    def __init__(self, clients: Sequence[ModuleClient]) -> None:
        self.clients = tuple(clients)
        self.infos: tuple[Info, ...] = ()
        self.slews: tuple[float, ...] = ()
        self.continuous: tuple[float, ...] = ()

    def prepare(self, rig: Rig, telemetry_ms: int) -> None:
        """Make sure that these modules can do what the rig says, and have them report.

        Raises
        ------
        HardwareError
            Naming the module: it is in use, has a fault, is not calibrated, or has other limits than the rig.
        """
        self.infos = tuple(client.check_info(info) for client, info in self._all(Hello(), Info))
        for client, info, module in zip(self.clients, self.infos, rig.modules, strict=True):
            if info.state in (State.ARMED, State.RUNNING):
                raise LinkError(f'module "{client.name}" at {client.link.url} is in use: somebody has it armed')
            client.require_cleared(info)
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
        self._all(Stop(), Acknowledge)  # one that timed out in an earlier run is still in it
        self._all(ConfigureTelemetry(telemetry_ms), Acknowledge)
        self.slews = self._values("slew")
        self.continuous = tuple(
            current * info.newton_per_ampere
            for current, info in zip(self._values("current_continuous"), self.infos, strict=True)
        )

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
            A module refuses, or does not answer. The others may be armed by then: `stop` them.
        """
        commands: dict[ModuleClient, Message] = {}
        for client in self.clients:
            client.begin_session()
            commands[client] = Arm(client.session)
        taut = dict(zip(self.clients, tensions, strict=True))
        _, failed = self._together(commands, Acknowledge, taut)
        for client in self.clients:
            client.forget_refusals()  # of set-points that were there before the module was armed
        for error in failed.values():
            raise error

    def stop(self) -> dict[str, HardwareError]:
        """Have all modules let go: all are told before any is waited for. Which did not confirm it, and why?"""
        return self._let_go(Stop())

    def emergency_stop(self) -> dict[str, HardwareError]:
        """Have all modules let go at once, and stay so. Which did not confirm it, and why?"""
        return self._let_go(EmergencyStop())

    def close(self) -> None:
        """Close all links. Modules that are still pulling notice, and let go by themselves."""

        def close(client: ModuleClient) -> None:
            with suppress(HardwareError):
                client.close()

        with ThreadPoolExecutor(len(self.clients) or 1) as threads:  # pyserial takes 0.3 s for each
            list(threads.map(close, self.clients))

    def _let_go(self, command: Message) -> dict[str, HardwareError]:
        _, failed = self._together(dict.fromkeys(self.clients, command), Acknowledge, {})
        there = {
            client
            for client in failed
            if isinstance(failed[client], ModuleFault) and client.state in LATCHED_STATES
        }
        return {client.name: error for client, error in failed.items() if client not in there}

    def _values(self, parameter: str) -> tuple[float, ...]:
        """Return a parameter of each."""
        command = GetParameter(PARAMETERS[parameter].index)
        return tuple(found.value for _, found in self._all(command, ParameterValue))

    def _all(self, command: Message, kind: type[AnswerType]) -> list[tuple[ModuleClient, AnswerType]]:
        """What does each answer? The first failure is raised."""
        answers, failed = self._together(dict.fromkeys(self.clients, command), kind, {})
        for error in failed.values():
            raise error
        return [(client, answers[client]) for client in self.clients]

    def _together(
        self,
        commands: Mapping[ModuleClient, Message],
        kind: type[AnswerType],
        taut: Mapping[ModuleClient, float],
    ) -> tuple[dict[ModuleClient, AnswerType], dict[ModuleClient, HardwareError]]:
        """Have commands carried out by all modules at the same time: answers, and why there is none.

        Meanwhile, modules in ``taut`` are sent that tension, so that none times out while another is waited for.
        """
        answers: dict[ModuleClient, AnswerType] = {}
        failed: dict[ModuleClient, HardwareError] = {}
        waiting: dict[ModuleClient, int] = {}
        left = set(commands)
        alive = 0.0
        for timeout in PATIENT_TIMEOUTS_S:
            for client in left:
                with _kept(failed, client):
                    waiting[client] = client.send(commands[client], waiting.get(client))
            end = time.monotonic() + timeout
            while (left := {client for client in waiting if client not in failed}) and time.monotonic() < end:
                for client in left:
                    client.listen()
                    with _kept(failed, client):
                        if (found := client.answer(commands[client], waiting[client], kind)) is not None:
                            answers[client] = found
                            del waiting[client]
                if time.monotonic() >= alive:
                    alive = time.monotonic() + KEPT_ALIVE
                    for client, tension in taut.items():
                        with _kept(failed, client):
                            client.set_tension(tension)
                if waiting:
                    self._breathe()
        for client in left:
            failed[client] = client.unanswered(commands[client], len(PATIENT_TIMEOUTS_S))
        return answers, failed

    def _breathe(self) -> None:
        """Let time pass: here, or in simulated modules of this process."""
        for client in self.clients:
            client.listen(BREATH)
        if not all(client.link.lockstep for client in self.clients):
            time.sleep(BREATH)


@contextmanager
def _kept(failed: dict[ModuleClient, HardwareError], client: ModuleClient) -> Iterator[None]:
    """Keep the error of one module, and go on with the others."""
    try:
        yield
    except HardwareError as error:
        failed[client] = error


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
