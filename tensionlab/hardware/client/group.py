"""Group of all modules of a rig, opened, armed and stopped together."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

import numpy as np
from numpy.typing import NDArray

from tensionlab import _native
from tensionlab.errors import HardwareError, LinkError, ModuleFault
from tensionlab.hardware.client.links import Link, not_taken
from tensionlab.hardware.client.module import PATIENT_TIMEOUTS_S, AnswerType, ModuleClient, require_ready
from tensionlab.hardware.protocol import messages
from tensionlab.hardware.protocol.codes import LATCHED_STATES, PARAMETERS, Limit, State
from tensionlab.hardware.protocol.messages import Acknowledge, Info, Message, Stop
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers

POLL_PERIOD_S = 2e-3
KEEP_ALIVE_PERIOD_S = 0.04  # period of set-points to a module that is armed while others are still being armed
LIMIT_TOLERANCE = 1e-6  # relative; the module stores its limits in 32 bits


class ModuleGroup:
    """Clients of all modules of a rig, in its order.

    After `prepare`, ``infos`` describes the modules, ``slews`` are the largest rates of change of their tensions
    in N/s, and ``frictions`` what each module compensates itself, in N and N s/m, if the rig has any.
    """

    def __init__(self, clients: Sequence[ModuleClient]) -> None:
        self.clients = tuple(clients)
        self.infos: tuple[Info, ...] = ()
        self.slews: tuple[float, ...] = ()
        self.frictions: tuple[tuple[float, ...], ...] = ()
        self._endpoints = _native.EndpointGroup([client.endpoint for client in self.clients])
        self._lockstep = tuple(client for client in self.clients if client.link.lockstep)

    def observe(self) -> tuple[Floats, Integers]:
        """Return the latest telemetry; a module without any has NaN, an infinite age, IDLE and -1.

        Lengths, speeds, tensions, ages, windings' temperatures and bearable tensions (6, m); states, faults,
        limiters, brakes and sequence numbers (5, m).
        """
        for client in self._lockstep:
            client.listen()
        return self._endpoints.observe(self._clocks(), State.IDLE, Limit.IDLE)

    def suspects(self, active: NDArray[np.bool_], delays: Floats, ttl: float) -> list[int]:
        """Return the indices of active modules (m,) that need a check in Python.

        The others follow set-points no older than `ttl` s, by their `delays` (m,), and their latest telemetry is
        plausible and no older.
        """
        return self._endpoints.suspects(self._clocks(), active, delays, ttl)

    def send_tensions(
        self, tensions: Floats, chosen: NDArray[np.bool_], brakes: NDArray[np.bool_], ttl_ms: int
    ) -> tuple[Integers, list[int], list[tuple[int, LinkError]]]:
        """Send tensions (m,) in N to the chosen modules (m,) whose links are written natively.

        Return the sequence numbers (m,), -1 where none was sent; the chosen modules still to send to; the errors.
        """
        sequences, remaining, failed = self._endpoints.send(tensions, chosen, brakes, ttl_ms)
        errors = [(index, not_taken(self.clients[index].link.url, why)) for index, why in failed]
        return sequences, remaining, errors

    def clear_checked(self) -> None:
        """Have the next check of each module ignore earlier telemetry."""
        for client in self.clients:
            client.endpoint.clear_checked()

    def _clocks(self) -> list[float]:
        return [client.link.clock() for client in self.clients]

    def prepare(self, rig: Rig, telemetry_ms: int) -> None:
        """Check that these modules can do what the rig says, and start their telemetry.

        A `HardwareError` names the module that is in use, has a fault, is not calibrated, or has other limits.
        """
        self.infos = self._all(messages.Hello(), Info)
        for client, info, module in zip(self.clients, self.infos, rig.modules, strict=True):
            require_ready(client, info)
            lower = info.tension_lower * (1.0 - LIMIT_TOLERANCE)
            upper = info.tension_upper * (1.0 + LIMIT_TOLERANCE)
            if not lower <= module.lower <= module.upper <= upper:
                own = f"pulls with {info.tension_lower:g} to {info.tension_upper:g} N"
                wanted = f"the rig wants {module.lower:g} to {module.upper:g} N"
                advice = "change the rig's limits, or the module's parameters tension_lower and tension_upper"
                raise HardwareError(f'module "{client.name}" {own}, but {wanted}; {advice}')
        self._all(Stop(), Acknowledge)  # a module may still be in TIMEOUT from an earlier run
        self._all(messages.ConfigureTelemetry(telemetry_ms), Acknowledge)
        self.slews = self._values("slew")
        if any(module.friction_coulomb or module.friction_viscous for module in rig.modules):
            names = ("friction_coulomb", "friction_viscous")
            self.frictions = tuple(zip(*map(self._values, names), strict=True))

    def require_lengths(self) -> None:
        """Raise a `HardwareError` that names the modules whose cable length is unknown."""
        known = dict(zip(self.clients, self.infos, strict=True))
        unknown = [client.name for client, info in known.items() if not info.length_known]
        if unknown:
            advice = "`tensionlab module calibrate lengths`, or give a tracker or a place"
            raise HardwareError(f"the cable lengths of {', '.join(unknown)} are not known: {advice}")

    def arm(self, tensions: Iterable[float]) -> None:
        """Arm all modules; those armed first are kept alive with the given tensions, in N.

        After an error, that a module refuses or does not answer, the others may be armed: `stop` them.
        """
        kept = dict(zip(self.clients, tensions, strict=True))
        infos = zip(self.clients, self._all(messages.Hello(), Info), strict=True)
        _, failed = self._together({client: client.new_session(info) for client, info in infos}, Acknowledge, kept)
        for client in self.clients:
            client.forget_refusals()  # of set-points that came before the module was armed
        for error in failed.values():
            raise error

    def stop(self) -> dict[str, HardwareError]:
        """Stop all modules, and return the errors of those that did not confirm it, by name."""
        return self._release(Stop())

    def emergency_stop(self) -> dict[str, HardwareError]:
        """Stop all modules until `clear`, and return the errors of those that did not confirm it."""
        return self._release(messages.EmergencyStop())

    def close(self) -> None:
        """Close all links, each in a thread; modules that are still pulling release their cables."""

        def close(client: ModuleClient) -> None:
            with suppress(HardwareError):
                client.close()

        with ThreadPoolExecutor(len(self.clients) or 1) as threads:
            list(threads.map(close, self.clients))

    def _release(self, command: Message) -> dict[str, HardwareError]:
        _, failed = self._together(dict.fromkeys(self.clients, command), Acknowledge, {})
        return {
            client.name: error
            for client, error in failed.items()
            if not (isinstance(error, ModuleFault) and client.state in LATCHED_STATES)
        }

    def _values(self, parameter: str) -> tuple[float, ...]:
        command = messages.GetParameter(PARAMETERS[parameter].index)
        return tuple(answer.value for answer in self._all(command, messages.ParameterValue))

    def _all(self, command: Message, kind: type[AnswerType]) -> tuple[AnswerType, ...]:
        """Return the answer of each module; the first error is raised."""
        answers, failed = self._together(dict.fromkeys(self.clients, command), kind, {})
        for error in failed.values():
            raise error
        return tuple(answers[client] for client in self.clients)

    def _together(
        self,
        commands: Mapping[ModuleClient, Message],
        kind: type[AnswerType],
        keep_alive: Mapping[ModuleClient, float],
    ) -> tuple[dict[ModuleClient, AnswerType], dict[ModuleClient, HardwareError]]:
        """Send commands to all modules before waiting for any answer; return answers and errors.

        Meanwhile, modules in ``keep_alive`` are sent that tension, so that none times out.
        """
        answers: dict[ModuleClient, AnswerType] = {}
        failed: dict[ModuleClient, HardwareError] = {}
        waiting: dict[ModuleClient, int] = {}
        unanswered = list(commands)
        begins = [client.link.clock() for client in self.clients]

        def elapsed() -> float:  # by the links' clocks, as the modules' own timeouts count
            return max(client.link.clock() - begin for client, begin in zip(self.clients, begins, strict=True))

        next_keep_alive = 0.0
        for timeout in PATIENT_TIMEOUTS_S:
            for client in unanswered:
                with _collecting(failed, client):
                    waiting[client] = client.send(commands[client], waiting.get(client))
            end = elapsed() + timeout
            while (unanswered := [client for client in waiting if client not in failed]) and elapsed() < end:
                for client in unanswered:
                    client.listen()
                    with _collecting(failed, client):
                        if (answer := client.answer(commands[client], waiting[client], kind)) is not None:
                            answers[client] = answer
                            del waiting[client]
                if elapsed() >= next_keep_alive:
                    next_keep_alive = elapsed() + KEEP_ALIVE_PERIOD_S
                    for client, tension in keep_alive.items():
                        with _collecting(failed, client):
                            client.set_tension(tension)
                if waiting:
                    for client in self.clients:
                        client.listen(POLL_PERIOD_S)
                    if not all(client.link.lockstep for client in self.clients):
                        time.sleep(POLL_PERIOD_S)
        for client in unanswered:
            failed[client] = client.no_answer(commands[client], len(PATIENT_TIMEOUTS_S))
        return answers, failed


@contextmanager
def _collecting(failed: dict[ModuleClient, HardwareError], client: ModuleClient) -> Iterator[None]:
    """Store the error of one module, and continue with the others."""
    try:
        yield
    except HardwareError as error:
        failed[client] = error


def connect(rig: Rig, links: Mapping[str, str | Link]) -> ModuleGroup:
    """Connect to all modules of a rig; ``links`` are links or URLs, by the module's name.

    HardwareError if the names are not those of the rig's modules, or a link cannot be opened; all are then closed.
    """
    names = [module.name for module in rig.modules]
    for name in links:
        if name not in names:
            raise HardwareError(f'rig "{rig.name}" has no module "{name}"; it has {", ".join(names)}')
    if missing := [name for name in names if name not in links]:
        raise HardwareError(f'rig "{rig.name}": no link for {", ".join(missing)}; give each module its own')

    def reach(name: str) -> ModuleClient | HardwareError:
        try:
            return ModuleClient(name, links[name])
        except HardwareError as error:
            return error

    with ThreadPoolExecutor(len(names)) as threads:  # Bluetooth takes seconds for each
        reached = list(threads.map(reach, names))
    group = ModuleGroup([client for client in reached if isinstance(client, ModuleClient)])
    for outcome in reached:
        if isinstance(outcome, HardwareError):
            group.close()
            raise outcome
    return group


@contextmanager
def temporary_slew(group: ModuleGroup, slew: float | None) -> Iterator[None]:
    """Set the modules' slew-rate limit in N/s, and restore it afterwards; None: leave them alone."""
    if slew is None:
        yield
        return
    previous_slews = [client.parameter("slew") for client in group.clients]
    for client in group.clients:
        client.set_parameter("slew", slew)
    try:
        yield
    finally:
        for client, own in zip(group.clients, previous_slews, strict=True):
            with suppress(HardwareError):  # the module is lost, and the run has said so
                client.set_parameter("slew", own)
