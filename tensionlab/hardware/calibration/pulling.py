"""Armed module that is given set-points by hand, to calibrate or examine it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from tensionlab.errors import HardwareError
from tensionlab.hardware.client.module import PATIENT_TIMEOUTS_S, ModuleClient
from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, Limit, State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Info, SetParameter, Telemetry
from tensionlab.hardware.runner.watchdog import stopping

PERIOD_S, TELEMETRY_MS = 0.02, 10  # from one set-point, and one telemetry message, to the next
MAX_SILENT_PERIODS = 25  # without telemetry
ARM_TRIES = 3
LIMITER_ADVICE = {
    Limit.THERMAL: "its winding is as warm as it may be; let it cool, and pull less",
    Limit.SPEED: "its cable reels in too fast; is there nothing on it?",
    Limit.LENGTH: "its cable is as short or as long as it may be; move the module, or calibrate its length",
}  # limiters that keep a module from the commanded tension, and what to do about them


class Puller:
    """Armed module, its description, and its telemetry since it was armed or `reports` was cleared."""

    def __init__(self, client: ModuleClient, info: Info) -> None:
        self.client, self.info = client, info
        self.reports: list[Telemetry] = []

    def hold(self, tension: float, ttl_ms: int = 0) -> Telemetry:
        """Pull with a tension for a period, and return the telemetry at its end; refuse a module that cannot."""
        for _ in range(MAX_SILENT_PERIODS):
            self.client.set_tension(tension, ttl_ms=ttl_ms)
            self.client.wait(PERIOD_S)
            self.client.check()
            if self.reports:
                break
        else:
            raise HardwareError(f'module "{self.client.name}" sends no telemetry')
        latest = self.reports[-1]
        if latest.limit in LIMITER_ADVICE:
            why = f"does not pull with {tension:.2f} N: {LIMITER_ADVICE[latest.limit]}"
            raise HardwareError(f'module "{self.client.name}" {why}')
        return latest


@contextmanager
def pulling(client: ModuleClient, info: Info) -> Iterator[Puller]:
    """Arm a module, and stop it at the end, also after an error.

    A module whose N/A was never calibrated refuses to be armed; meanwhile it is marked as calibrated. A
    `HardwareError` if that could not be undone.
    """
    puller = Puller(client, info)
    client.record(puller.reports)
    try:
        if not info.calibrated:
            client.calibrate(Calibration.NEWTON_PER_AMPERE, info.newton_per_ampere)
        with stopping(client.stop, client.estop):
            client.command(ConfigureTelemetry(TELEMETRY_MS))
            for _ in range(ARM_TRIES):  # it times out if answers are lost
                client.arm()
                client.set_tension(info.tension_lower)
                client.wait(0.1)
                if client.state is not State.TIMEOUT:
                    break
                client.stop()
            yield puller
    finally:
        ended = sys.exception()
        client.record(None)
        with suppress(HardwareError):
            client.command(ConfigureTelemetry(0))
            client.wait(0.3)  # until nothing pulls any more
        if not info.calibrated:  # it is to refuse to be armed again
            try:
                client.command(SetParameter(PARAMETERS["calibrated"].index, 0.0), PATIENT_TIMEOUTS_S)
            except HardwareError as error:
                armable = (
                    f'module "{client.name}" counts as calibrated though its N/A was never measured, and can be '
                    f"armed: switch it off and on before anything else ({error})"
                )
                if ended is None:
                    raise HardwareError(armable) from None
                ended.args = (f"{ended}. And {armable}",)
