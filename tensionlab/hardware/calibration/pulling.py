"""Module that is armed by the host for a while, and stopped whatever happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from tensionlab.errors import HardwareError, ModuleFault
from tensionlab.hardware.client.locks import ESTOP_SIGNAL
from tensionlab.hardware.client.module import ModuleClient, Received
from tensionlab.hardware.protocol.codes import Calibration, Limit, State
from tensionlab.hardware.protocol.messages import Info, Message, Telemetry
from tensionlab.hardware.runner.watchdog import ENDING, Interrupted, Interrupts

PERIOD_S = 0.02
"""From one set-point to the next, in s."""
TELEMETRY_MS = 10
MAX_SILENT_PERIODS = 25
"""Without telemetry."""
ARM_TRIES = 3
LIMITER_ADVICE = {
    Limit.THERMAL: "its winding's budget is spent; let it cool, and pull less",
    Limit.SPEED: "its cable reels in too fast; is there nothing on it?",
    Limit.LENGTH: "its cable is as short or as long as it may be; move the module, or calibrate its length",
}
"""Limiters that keep a module from the commanded tension, and what to do about them."""


class Puller:
    """Armed module, what it said of itself, and its telemetry since `forget`, or since it was armed."""

    def __init__(self, client: ModuleClient, info: Info) -> None:
        self.client = client
        self.info = info
        self.heard: list[Telemetry] = []

    def take(self, heard: Received[Message]) -> None:
        """Store telemetry."""
        if isinstance(heard.message, Telemetry):
            self.heard.append(heard.message)

    def forget(self) -> None:
        """Discard the telemetry up to now."""
        self.heard.clear()

    def hold(self, tension: float) -> Telemetry:
        """Pull with so many N for a period, and return the telemetry at its end; refuse a module that cannot."""
        for _ in range(MAX_SILENT_PERIODS):
            self.client.set_tension(tension)
            self.client.wait(PERIOD_S)
            self.client.check()
            if self.heard:
                break
        else:
            raise HardwareError(f'module "{self.client.name}" sends no telemetry')
        latest = self.heard[-1]
        if latest.limit in LIMITER_ADVICE:
            raise HardwareError(
                f'module "{self.client.name}" does not pull with {tension:.2f} N: {LIMITER_ADVICE[latest.limit]}'
            )
        return latest


@contextmanager
def stopping(stop: Callable[[], None], stop_at_once: Callable[[], None]) -> Iterator[None]:
    """Call `stop` in the end, whatever it is that ends this: also Ctrl-C, and signals that would end the program.

    `tensionlab estop` has `stop_at_once` called. Errors of stopping are raised only where there is no other.
    """
    interrupts = Interrupts()
    with interrupts.caught((*ENDING, ESTOP_SIGNAL)):
        try:
            yield
        except BaseException as error:
            interrupts.ignore()
            at_once = isinstance(error, Interrupted) and error.number == ESTOP_SIGNAL
            with suppress(HardwareError):
                (stop_at_once if at_once else stop)()
            raise
        interrupts.ignore()
        stop()


@contextmanager
def pulling(client: ModuleClient) -> Iterator[Puller]:
    """Arm a module, and stop it at the end, also if that is an error.

    A module whose N/A was never calibrated refuses to be armed; for as long as this lasts it is taken for
    calibrated.
    """
    info = client.hello()
    if info.state is not State.IDLE:
        raise ModuleFault(
            f'module "{client.name}" is {info.state.name}, not IDLE; stop it first (after a fault: clear it)',
            client.name,
            info.state,
        )
    puller = Puller(client, info)
    if not info.calibrated:
        client.calibrate(Calibration.NEWTON_PER_AMPERE, info.newton_per_ampere)
    before, client.on_message = client.on_message, puller.take
    try:
        with stopping(client.stop, client.estop):
            client.telemetry_every(TELEMETRY_MS)
            _arm(client, info.tension_lower)
            yield puller
    finally:
        client.on_message = before
        with suppress(HardwareError):
            client.telemetry_every(0)
            client.wait(0.3)  # until nothing pulls any more
            if not info.calibrated:
                client.set_parameter("calibrated", 0.0)


def _arm(client: ModuleClient, tension: float) -> None:
    """Arm a module. Where the answer is lost, it may have timed out before the next one comes: then once more."""
    for _ in range(ARM_TRIES):
        client.arm()
        client.set_tension(tension)
        client.wait(0.1)
        if client.state is not State.TIMEOUT:
            return
        client.stop()
