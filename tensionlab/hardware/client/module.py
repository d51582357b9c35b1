"""Client of one module: a method for each command."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from types import TracebackType
from typing import Self

from tensionlab.errors import HardwareError, ModuleFault
from tensionlab.hardware.client.connection import Connection
from tensionlab.hardware.client.links import Link
from tensionlab.hardware.protocol.codes import LATCHED_STATES, RELEASED_STATES, Calibration, Fault
from tensionlab.hardware.protocol.messages import (
    Arm,
    Calibrate,
    Clear,
    ConfigureTelemetry,
    EmergencyStop,
    GetParameter,
    Hello,
    Info,
    ParameterValue,
    Ping,
    Pong,
    Save,
    SetImpedance,
    SetParameter,
    SetTension,
    Stop,
)
from tensionlab.hardware.protocol.parameters import PARAMETERS, require_name, require_value

SAVE_TIMEOUTS_S = (2.0, 2.0, 2.0)
"""How long each try waits for an answer to a command that takes the module long."""


class ModuleClient(Connection):
    """Client of one module: a `Connection`, and the `session` of the last `arm`."""

    def __init__(self, name: str, link: Link | str, seed: int | None = None) -> None:
        super().__init__(name, link, seed)
        self.session = 0

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the module after an error, and close the link."""
        if kind is not None:
            with suppress(HardwareError):
                self.stop()
        self.close()

    def hello(self) -> Info:
        """Return the module's description of itself; errors as those of `command`."""
        return self.check_info(self.request(Hello(), Info))

    def check_info(self, info: Info) -> Info:
        """Store the state of a description, and return the description."""
        self.state = info.state
        return info

    def require_cleared(self, info: Info) -> None:
        """Refuse a module that is in fault or emergency stop, by a `ModuleFault` that says what to do."""
        if info.state in LATCHED_STATES:
            raise ModuleFault(
                f'module "{self.name}" is in {info.state.name}: find out why, then '
                f"`tensionlab module clear {self.link.url}`",
                self.name,
                info.state,
            )

    def ping(self) -> tuple[float, int]:
        """Return the round-trip time of a message, in s, and the module's clock, in us."""
        began = self.link.clock()
        pong = self.request(Ping(self._random.getrandbits(64)), Pong)
        return self.link.clock() - began, pong.time_us

    def arm(self) -> None:
        """Make the module pull with the taut minimum, and wait for set-points of a new session."""
        self.begin_session()
        self.command(Arm(self.session))

    def begin_session(self) -> None:
        """Draw the session of the next `Arm`; a module accepts each only once."""
        self.session = self._random.randrange(1, 1 << 16)

    def wait(self, seconds: float) -> None:
        """Let time pass by the module's link: a simulated module runs meanwhile, a real one does so anyway."""
        end = self.link.clock() + seconds
        self.listen(seconds)
        left = end - self.link.clock()
        if left > 1e-3:  # a simulated module goes by its steps
            time.sleep(left)

    def stop(self) -> None:
        """Make the module release its cable and be idle; a fault or an emergency stop needs `clear`."""
        self.command(Stop())

    def estop(self) -> None:
        """Make the module release its cable at once, and stay so until `clear`."""
        self.command(EmergencyStop())

    def clear(self) -> None:
        """Make the module leave fault or emergency stop."""
        self.command(Clear())
        self.faults = Fault(0)

    def telemetry_every(self, period_ms: int) -> None:
        """Set the period of telemetry, in ms; 0 for none."""
        self.command(ConfigureTelemetry(period_ms))

    def calibrate(self, what: Calibration, value: float = 0.0) -> None:
        """Give the module a measured length or N/A, or make it find its motor's zero."""
        self.command(Calibrate(what, value), SAVE_TIMEOUTS_S)

    def parameter(self, name: str) -> float:
        """Return the value of a parameter."""
        return self.request(GetParameter(require_name(name).index), ParameterValue).value

    def set_parameter(self, name: str, value: float) -> None:
        """Change a parameter until the next start, or for good with `save`."""
        require_value(name, value, f'module "{self.name}"')
        self.command(SetParameter(PARAMETERS[name].index, value))

    def save(self) -> None:
        """Store the module's parameters for good."""
        self.command(Save(), SAVE_TIMEOUTS_S)

    def set_tension(self, tension: float, *, brake: bool = False, ttl_ms: int = 0) -> int:
        """Command a tension, in N; return the sequence number, which telemetry repeats."""
        return self.send_set_point(SetTension(self.session, tension, brake, ttl_ms))

    def set_impedance(self, setting: SetImpedance) -> int:
        """Command a spring and damper, with this session; return the sequence number."""
        return self.send_set_point(replace(setting, session=self.session))

    def check(self) -> None:
        """Raise the error of what has gone wrong since the last call.

        Raises
        ------
        LinkError
            The link broke.
        ModuleFault
            The module refused a set-point, or has released its cable.
        """
        if self._broken is not None:
            raise self._broken
        if self.state in RELEASED_STATES:
            faults = f": {self.faults.name or int(self.faults)}" if self.faults else ""
            raise ModuleFault(
                f'module "{self.name}" has released its cable ({self.state.name}{faults})',
                self.name,
                self.faults or self.state,
            )
        if self._refused is not None:
            code = self._refused.code
            self._refused = None
            raise ModuleFault(f'module "{self.name}" refused a set-point: {code.name}', self.name, code)

    def forget_refusals(self) -> None:
        """Discard the refusals up to now."""
        self._refused = None
