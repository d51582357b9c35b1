"""The commands of one module, as the host gives them: what is it, arm, pull, stop, set up."""

from __future__ import annotations

import random
from contextlib import suppress
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
"""How long each try waits for an answer, in s, to what takes a module long."""


class ModuleClient(Connection):
    """Have one module do what there is a command for.

    Parameters
    ----------
    name : str
        What the module is called in messages.
    link : Link or str
        A link, or the URL of one.

    Attributes
    ----------
    session : int
        Of the last `arm`; set-points carry it. What the module has said of itself is with the `Connection`.
    """

    def __init__(self, name: str, link: Link | str) -> None:
        super().__init__(name, link)
        self.session = 0

    def __enter__(self) -> Self:
        """Stay open in a with block."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let the module go, and close the link."""
        if kind is not None:
            with suppress(HardwareError):
                self.stop()
        self.close()

    # Questions and commands: each waits for its answer.

    def hello(self) -> Info:
        """Ask the module what it is; errors as those of `command`."""
        return self.check_info(self.request(Hello(), Info))

    def check_info(self, info: Info) -> Info:
        """Take note of what the module said of itself."""
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
        """How long does a message take there and back, in s, and what does the module's clock show, in us?"""
        began = self.link.clock()
        pong = self.request(Ping(random.getrandbits(64)), Pong)
        return self.link.clock() - began, pong.time_us

    def arm(self) -> None:
        """Let the module pull with the taut minimum, and wait for set-points of a new session."""
        self.begin_session()
        self.command(Arm(self.session))

    def begin_session(self) -> None:
        """Make up the session that the next `Arm` begins. A module takes each only once."""
        self.session = random.randrange(1, 1 << 16)

    def stop(self) -> None:
        """Have the module let go and be idle. From a fault or an emergency stop it takes `clear`."""
        self.command(Stop())

    def estop(self) -> None:
        """Have the module let go at once, and stay so until `clear`."""
        self.command(EmergencyStop())

    def clear(self) -> None:
        """Have the module leave fault or emergency stop."""
        self.command(Clear())
        self.faults = Fault(0)

    def telemetry_every(self, period_ms: int) -> None:
        """Have the module send telemetry every so many ms; 0: never."""
        self.command(ConfigureTelemetry(period_ms))

    def calibrate(self, what: Calibration, value: float = 0.0) -> None:
        """Have the module take over something measured, or find its motor's zero."""
        self.command(Calibrate(what, value), SAVE_TIMEOUTS_S)

    def parameter(self, name: str) -> float:
        """Which value has a parameter?"""
        return self.request(GetParameter(require_name(name).index), ParameterValue).value

    def set_parameter(self, name: str, value: float) -> None:
        """Change a parameter until the next start, or for good with `save`."""
        require_value(name, value, f'module "{self.name}"')
        self.command(SetParameter(PARAMETERS[name].index, value))

    def save(self) -> None:
        """Have the module store its parameters."""
        self.command(Save(), SAVE_TIMEOUTS_S)

    # Set-points: nobody answers, and the next one comes soon.

    def set_tension(self, tension: float, *, brake: bool = False, ttl_ms: int = 0) -> int:
        """Have the module pull with so many N. Returns the sequence number, which telemetry repeats."""
        return self.send_set_point(SetTension(self.session, tension, brake, ttl_ms))

    def set_impedance(self, setting: SetImpedance) -> int:
        """Have the module render a spring and damper; the session is filled in. Returns the sequence number."""
        fields = {name: getattr(setting, name) for name in SetImpedance.__dataclass_fields__}
        return self.send_set_point(SetImpedance(**{**fields, "session": self.session}))

    def check(self) -> None:
        """Raise what has gone wrong since the last call.

        Raises
        ------
        LinkError
            The link broke.
        ModuleFault
            The module refused a set-point, or has let go.
        """
        if self._broken is not None:
            raise self._broken
        if self.state in RELEASED_STATES:
            faults = f": {self.faults.name or int(self.faults)}" if self.faults else ""
            raise ModuleFault(
                f'module "{self.name}" has let go ({self.state.name}{faults})',
                self.name,
                self.faults or self.state,
            )
        if self._refused is not None:
            code = self._refused.code
            self._refused = None
            raise ModuleFault(f'module "{self.name}" refused a set-point: {code.name}', self.name, code)

    def forget_refusals(self) -> None:
        """Do not raise what the module has refused up to now."""
        self._refused = None
