"""One module as the host sees it: commands out, answers and telemetry in."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Generic, Self, TypeVar

from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault, ProtocolError
from tensionlab.hardware.codes import Calibration, Code, Fault, State
from tensionlab.hardware.frames import Decoder
from tensionlab.hardware.link import Link, open_link
from tensionlab.hardware.protocol import (
    PROTOCOL,
    Acknowledge,
    Arm,
    Calibrate,
    Clear,
    ConfigureTelemetry,
    EmergencyStop,
    Event,
    GetParameter,
    Hello,
    Info,
    Log,
    Message,
    ParameterValue,
    Ping,
    Pong,
    Save,
    SetImpedance,
    SetParameter,
    SetTension,
    Stop,
    Telemetry,
    read,
)
from tensionlab.hardware.simulated import PARAMETERS, single

TRIES = (0.2, 0.3, 0.45)
"""How long each try waits for an answer, in s."""
SAVE_TRIES = (2.0, 2.0, 2.0)
"""The same for what takes a module long."""
LET_GO = frozenset((State.TIMEOUT, State.FAULT, State.ESTOP))
"""States in which a module follows no set-points any more, without having been told to stop."""
LISTEN = 0.1
"""The reader looks up so often, in s, when nothing comes."""

AnswerType = TypeVar("AnswerType", bound=Message)
Said_co = TypeVar("Said_co", bound=Message, covariant=True)


@dataclass(frozen=True)
class Heard(Generic[Said_co]):
    """What a module has said without being asked, and when.

    Attributes
    ----------
    message : Telemetry, Event or Log
    time : float
        When it came, by the clock of the link, in s.
    """

    message: Said_co
    time: float


class ModuleClient:
    """Talk to one module.

    A thread reads the link; with a simulated module in this process there is none, and what the module says is
    read whenever it is asked for something, or by `listen`.

    Parameters
    ----------
    name : str
        What the module is called in messages.
    link : Link or str
        A link, or the URL of one.

    Attributes
    ----------
    telemetry : Heard or None
        The latest, and when it came.
    state : State or None
        As the latest message had it.
    faults : Fault
        As the latest telemetry or event had them.
    session : int
        Of the last `arm`; set-points carry it.
    """

    def __init__(self, name: str, link: Link | str) -> None:
        self.name = name
        self.link = open_link(link) if isinstance(link, str) else link
        self.telemetry: Heard[Telemetry] | None = None
        self.state: State | None = None
        self.faults = Fault(0)
        self.session = 0
        self.on_message: Callable[[Heard[Message]], None] | None = None
        self._decoder = Decoder()
        self._sequence = random.randrange(256)
        self._set_point = random.randrange(256)
        self._answers: dict[int, Message] = {}
        self._refused: list[Acknowledge] = []
        self._strange = 0
        self._broken: LinkError | None = None
        self._news = threading.Condition()
        self._closing = False
        self._reader: threading.Thread | None = None
        if not self.link.lockstep:
            self._reader = threading.Thread(target=self._read, name=f"reader of {name}", daemon=True)
            self._reader.start()

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

    def close(self) -> None:
        """Close the link. A module that was pulling notices, and lets go by itself."""
        self._closing = True
        self.link.close()
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(timeout=1.0)

    # Questions and commands: each waits for its answer.

    def hello(self) -> Info:
        """What is this module? A `ProtocolError` if it speaks another protocol."""
        return self.met(self.ask(Hello(), Info))

    def met(self, info: Info) -> Info:
        """Take note of what the module said of itself. A `ProtocolError` if it speaks another protocol."""
        if info.protocol != PROTOCOL:
            raise ProtocolError(
                f'module "{self.name}" speaks protocol {info.protocol}, this host {PROTOCOL}; update the older one'
            )
        self.state = info.state
        return info

    def ping(self) -> tuple[float, int]:
        """How long does a message take there and back, in s, and what does the module's clock show, in us?"""
        began = self.link.clock()
        pong = self.ask(Ping(random.getrandbits(64)), Pong)
        return self.link.clock() - began, pong.time_us

    def arm(self) -> None:
        """Let the module pull with the taut minimum, and wait for set-points of a new session."""
        self.begin_session()
        self.tell(Arm(self.session))

    def stop(self) -> None:
        """Have the module let go and be idle. From a fault or an emergency stop it takes `clear`."""
        self.tell(Stop())

    def estop(self) -> None:
        """Have the module let go at once, and stay so until `clear`."""
        self.tell(EmergencyStop())

    def clear(self) -> None:
        """Have the module leave fault or emergency stop."""
        self.tell(Clear())
        self.faults = Fault(0)

    def telemetry_every(self, period_ms: int) -> None:
        """Have the module send telemetry every so many ms; 0: never."""
        self.tell(ConfigureTelemetry(period_ms))

    def calibrate(self, what: Calibration, value: float = 0.0) -> None:
        """Have the module take over something measured, or find its motor's zero."""
        self.tell(Calibrate(what, value), SAVE_TRIES)

    def parameter(self, name: str) -> float:
        """Which value has a parameter?"""
        return self.ask(GetParameter(PARAMETERS[known(name)].index), ParameterValue).value

    def set_parameter(self, name: str, value: float) -> None:
        """Change a parameter until the next start, or for good with `save`."""
        row = PARAMETERS[known(name)]
        if not row.lower <= single(value) <= row.upper:
            raise ProtocolError(
                f'module "{self.name}": {name} is from {row.lower:g} to {row.upper:g} {row.unit}; got {value:g}'
            )
        self.tell(SetParameter(row.index, value))

    def save(self) -> None:
        """Have the module store its parameters."""
        self.tell(Save(), SAVE_TRIES)

    # Set-points: nobody answers, and the next one comes soon.

    def set_tension(self, tension: float, *, brake: bool = False, ttl_ms: int = 0) -> int:
        """Have the module pull with so many N. Returns the sequence number, which telemetry repeats."""
        return self._send(SetTension(self.session, tension, brake, ttl_ms))

    def set_impedance(self, setting: SetImpedance) -> int:
        """Have the module render a spring and damper; the session is filled in. Returns the sequence number."""
        fields = {name: getattr(setting, name) for name in SetImpedance.__dataclass_fields__}
        return self._send(SetImpedance(**{**fields, "session": self.session}))

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
        if self.state in LET_GO:
            faults = f": {self.faults.name or int(self.faults)}" if self.faults else ""
            raise ModuleFault(
                f'module "{self.name}" has let go ({self.state.name}{faults})',
                self.name,
                self.faults or self.state,
            )
        if self._refused:
            code = self._refused[-1].code
            self._refused = []
            raise ModuleFault(f'module "{self.name}" refused a set-point: {code.name}', self.name, code)

    def forget_refusals(self) -> None:
        """Do not raise what the module has refused up to now."""
        self._refused = []

    @property
    def bad_frames(self) -> int:
        """How many frames came damaged, or said what nobody understands?"""
        return self._decoder.bad_frames + self._strange

    def listen(self, seconds: float = 0.0) -> None:
        """Read what a simulated module has said, and let it go on for so long; others are read all the time."""
        if self._reader is not None or self._broken is not None:
            return
        try:
            end = self.link.clock() + seconds if seconds else 0.0
            while content := self.link.receive(end - self.link.clock() if seconds else 0.0):
                self._take(content)
        except LinkError as error:
            self._broken = error

    def tell(self, command: Message, tries: tuple[float, ...] = TRIES) -> None:
        """Have a command carried out.

        Raises
        ------
        ModuleFault
            The module refuses; the code says why.
        LinkTimeout, LinkError
            It does not answer; the link broke.
        """
        self.ask(command, Acknowledge, tries)

    def ask(self, command: Message, answer: type[AnswerType], tries: tuple[float, ...] = TRIES) -> AnswerType:
        """What does the module answer? Errors as those of `tell`. A repeated command has the same number."""
        sequence: int | None = None
        for timeout in tries:
            sequence = self.post(command, sequence)
            end = self.link.clock() + timeout
            while (found := self.answer(command, sequence)) is None and (left := end - self.link.clock()) > 0:
                if not self._wait(sequence, left):
                    break
            if isinstance(found, answer):
                return found
        raise LinkTimeout(
            f'module "{self.name}" at {self.link.url} did not answer {type(command).__name__} '
            f"in {len(tries)} tries; is it on, and in range?"
        )

    def begin_session(self) -> None:
        """Make up the session that the next `Arm` begins. A module takes each only once."""
        self.session = random.randrange(1, 1 << 16)

    def post(self, command: Message, sequence: int | None = None) -> int:
        """Send a command without waiting; returns its number. Sent again, it keeps the number it had."""
        if sequence is None:
            sequence = self._next_set_point() if isinstance(command, Arm) else self._next()
            with self._news:
                self._answers.pop(sequence, None)
        self.link.send(command.frame(sequence).pack())
        return sequence

    def answer(self, command: Message, sequence: int) -> Message | None:
        """What has come in answer to a command? None if nothing yet; errors as those of `tell`."""
        if self._broken is not None:
            raise self._broken
        with self._news:
            found = self._answers.pop(sequence, None)
        if found is None or (isinstance(found, Acknowledge) and found.command is not command.type):
            return None
        if isinstance(found, Acknowledge) and found.code is not Code.OK:
            raise ModuleFault(
                f'module "{self.name}" refused {type(command).__name__}: {found.code.name} '
                f"(it is {found.state.name})",
                self.name,
                found.code,
            )
        return found

    def _wait(self, sequence: int, seconds: float) -> bool:
        """Wait for an answer, for so long at most; False if nothing came."""
        if self._reader is None:
            content = self.link.receive(seconds)
            self._take(content)
            return bool(content)
        with self._news:
            return self._news.wait_for(lambda: sequence in self._answers or self._broken is not None, seconds)

    def _send(self, message: Message) -> int:
        sequence = self._next_set_point()
        self.link.send(message.frame(sequence).pack())
        return sequence

    def _next(self) -> int:
        with self._news:
            self._sequence = (self._sequence + 1) % 256
            return self._sequence

    def _next_set_point(self) -> int:
        """Count ARM and set-points by themselves: the module takes what is up to 127 after the last."""
        with self._news:
            self._set_point = (self._set_point + 1) % 256
            return self._set_point

    def _read(self) -> None:
        while not self._closing:
            try:
                content = self.link.receive(LISTEN)
            except LinkError as error:
                with self._news:
                    self._broken = error
                    self._news.notify_all()
                return
            self._take(content)

    def _take(self, content: bytes) -> None:
        """Sort what came: answers for who waits for them, the rest for all."""
        if not content:
            return
        now = self.link.clock()
        for frame in self._decoder.feed(content):
            try:
                message = read(frame)
            except ProtocolError:
                self._strange += 1
                continue
            if not isinstance(message, Telemetry | Event | Log):
                with self._news:
                    if isinstance(message, Acknowledge):
                        self.state = message.state
                        if message.command in (SetTension.type, SetImpedance.type):
                            self._refused.append(message)
                            continue
                    self._answers[frame.sequence] = message
                    self._news.notify_all()
                continue
            if isinstance(message, Telemetry):
                self.telemetry = Heard(message, now)
            if isinstance(message, Telemetry | Event):
                self.state, self.faults = message.state, message.faults
            if self.on_message is not None:
                self.on_message(Heard(message, now))


def known(name: str) -> str:
    """Check the name of a parameter; a `ProtocolError` names those that there are."""
    if name not in PARAMETERS:
        raise ProtocolError(f"modules have no parameter {name!r}; they have {', '.join(PARAMETERS)}")
    return name
