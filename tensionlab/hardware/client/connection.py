"""Connection to a module: numbered messages out; answers and telemetry in."""

from __future__ import annotations

import random
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from tensionlab.errors import LinkError, LinkTimeout, ModuleFault, ProtocolError
from tensionlab.hardware.client.links import Link, open_link
from tensionlab.hardware.protocol.codes import Code, Fault, State, Type
from tensionlab.hardware.protocol.frames import Decoder
from tensionlab.hardware.protocol.messages import (
    Acknowledge,
    Arm,
    Event,
    Log,
    Message,
    OtherProtocolError,
    Protocol1Listener,
    SetImpedance,
    SetTension,
    Telemetry,
    read,
    repeated_in_protocol_1,
)

ANSWER_TIMEOUTS_S = (0.2, 0.3, 0.45)
"""How long each try waits for an answer."""
RESTARTED_US = 1_000_000
"""A module's clock that has gone back by so much has restarted."""
CLOCK_WRAP_US = 1 << 32
"""Where the clocks of modules wrap around."""
READ_TIMEOUT_S = 0.1
"""How long the reader waits before it checks whether to end."""
ANSWERS = (Type.INFO, Type.PARAMETER, Type.PONG)
"""Frames whose damage is an error of the request that waits for them."""

AnswerType = TypeVar("AnswerType", bound=Message)
MessageType_co = TypeVar("MessageType_co", bound=Message, covariant=True)


@dataclass(frozen=True)
class Received(Generic[MessageType_co]):
    """Unrequested message of a module, and when it came by the clock of the link, in s."""

    message: MessageType_co
    time: float


class Connection:
    """Connection to one module: commands, their answers, and messages that the module sends by itself.

    A thread reads the link. Of a simulated module in this process, messages are read by each request and `listen`.

    Parameters
    ----------
    name : str
        The module's name in error messages.
    link : Link or str
        A link, or the URL of one.
    seed : int, optional
        Of the numbers that messages and sessions begin with, for a simulation that is to be the same again.

    Attributes
    ----------
    telemetry : Received or None
        The latest.
    stale_frames, repeated : int
        Ignored telemetry that was no newer than the latest: altogether, and since the latest.
    state, faults
        Of the latest message that had them.
    on_message : callable or None
        Called with each unrequested message.
    """

    def __init__(self, name: str, link: Link | str, seed: int | None = None) -> None:
        self.name = name
        self.link = open_link(link) if isinstance(link, str) else link
        self.telemetry: Received[Telemetry] | None = None
        self.stale_frames = self.repeated = 0
        self.state: State | None = None
        self.faults = Fault(0)
        self.on_message: Callable[[Received[Message]], None] | None = None
        self._decoder = Decoder()
        self._random = random.Random(seed)
        self._sequence = self._random.randrange(256)
        self._set_point = self._armed = self._random.randrange(256)
        self._listener: Protocol1Listener | None = None
        self._answers: dict[int, Message | ProtocolError] = {}
        self._refused: Acknowledge | None = None  # the latest refused set-point
        self._unreadable = 0
        self._broken: LinkError | None = None
        self._arrived = threading.Condition()
        self._closing = False
        self._reader: threading.Thread | None = None
        if not self.link.lockstep:
            self._reader = threading.Thread(target=self._read, name=f"reader of {name}", daemon=True)
            self._reader.start()

    def close(self) -> None:
        """Close the link; a module that was pulling notices, and releases its cable."""
        self._closing = True
        self.link.close()
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(timeout=1.0)

    def command(self, command: Message, tries: tuple[float, ...] = ANSWER_TIMEOUTS_S) -> None:
        """Send a command and wait until it is acknowledged.

        Raises
        ------
        ModuleFault
            The module refuses; the code says why.
        LinkTimeout, LinkError
            It does not answer; the link broke.
        ProtocolError
            The module speaks another protocol, or its answer makes no sense.
        """
        self.request(command, Acknowledge, tries)

    def request(
        self, command: Message, answer: type[AnswerType], tries: tuple[float, ...] = ANSWER_TIMEOUTS_S
    ) -> AnswerType:
        """Return the answer to a command, which keeps its number when repeated; errors as those of `command`."""
        sequence: int | None = None
        for timeout in tries:
            sequence = self.send(command, sequence)
            end = self.link.clock() + timeout
            while (found := self.answer(command, sequence, answer)) is None:
                left = end - self.link.clock()
                if left <= 0 or not self._wait(sequence, left):
                    break
            if found is not None:
                return found
        raise self.unanswered(command, len(tries))

    def send(self, command: Message, sequence: int | None = None) -> int:
        """Send a command without waiting and return its number; sent again, it keeps its number."""
        if sequence is None:
            sequence = self._next_set_point() if isinstance(command, Arm) else self._next()
            if isinstance(command, Arm):
                self._armed = sequence
            with self._arrived:
                self._answers.pop(sequence, None)
            self.link.send(command.frame(sequence).pack())
            return sequence
        # No answer: does the module speak protocol 1?
        self._listener = self._listener or Protocol1Listener()
        frame = command.frame(sequence)
        self.link.send(frame.pack() + repeated_in_protocol_1(frame))
        return sequence

    def answer(self, command: Message, sequence: int, kind: type[AnswerType]) -> AnswerType | None:
        """Return the answer to a command if it has come, else None; errors as those of `command`."""
        if self._broken is not None:
            raise self._broken
        with self._arrived:
            found = self._answers.pop(sequence, None)
        if isinstance(found, OtherProtocolError):
            raise ProtocolError(f'module "{self.name}" {found}')
        if isinstance(found, ProtocolError):
            raise ProtocolError(f'module "{self.name}" answered what makes no sense: {found}')
        if isinstance(found, Acknowledge) and found.command is not command.type:
            return None
        if isinstance(found, Acknowledge) and found.code is not Code.OK:
            raise ModuleFault(
                f'module "{self.name}" refused {type(command).__name__}: {found.code.name} '
                f"(it is {found.state.name})",
                self.name,
                found.code,
            )
        return found if isinstance(found, kind) else None

    def unanswered(self, command: Message, tries: int) -> LinkTimeout:
        """Return the error of a command that was sent so many times."""
        return LinkTimeout(
            f'module "{self.name}" at {self.link.url} did not answer {type(command).__name__} in {tries} tries; '
            "is it on, and in range?"
        )

    def send_set_point(self, message: SetTension | SetImpedance) -> int:
        """Send a set-point, which is not answered, and return its number."""
        sequence = self._next_set_point()
        self.link.send(message.frame(sequence).pack())
        return sequence

    def listen(self, seconds: float = 0.0) -> None:
        """Let a simulated module run for some seconds and read its messages; others are read all the time."""
        if self._reader is not None or self._broken is not None:
            return
        try:
            end = self.link.clock() + seconds if seconds else 0.0
            while content := self.link.receive(end - self.link.clock() if seconds else 0.0):
                self._take(content)
        except LinkError as error:
            self._broken = error

    @property
    def reports_since_arm(self) -> bool:
        """Whether the latest telemetry reports a set-point since the latest ARM."""
        if self.telemetry is None:
            return False
        since = (self.telemetry.message.sequence - self._armed) % 256
        return since <= (self._set_point - self._armed) % 256

    @property
    def bad_frames(self) -> int:
        """Number of frames that were damaged or could not be read."""
        return self._decoder.bad_frames + self._unreadable

    def _wait(self, sequence: int, seconds: float) -> bool:
        """Wait for an answer; return False if nothing came in time."""
        if self._reader is None:
            content = self.link.receive(seconds)
            self._take(content)
            return bool(content)
        with self._arrived:
            return self._arrived.wait_for(lambda: sequence in self._answers or self._broken is not None, seconds)

    def _next(self) -> int:
        with self._arrived:
            self._sequence = (self._sequence + 1) % 256
            return self._sequence

    def _next_set_point(self) -> int:
        """Return the next number of ARM and set-points: the module accepts up to 127 after the last."""
        with self._arrived:
            self._set_point = (self._set_point + 1) % 256
            return self._set_point

    def _read(self) -> None:
        while not self._closing:
            try:
                content = self.link.receive(READ_TIMEOUT_S)
            except LinkError as error:
                with self._arrived:
                    self._broken = error
                    self._arrived.notify_all()
                return
            self._take(content)

    def _take(self, content: bytes) -> None:
        """Decode received bytes: answers for those who wait, the rest for `on_message`."""
        if not content:
            return
        now = self.link.clock()
        if self._listener is not None:
            with self._arrived:
                self._answers |= self._listener.feed(content)
                self._arrived.notify_all()
        for frame in self._decoder.feed(content):
            try:
                message = read(frame)
            except ProtocolError as error:
                self._unreadable += 1
                if frame.type in ANSWERS:
                    with self._arrived:
                        self._answers[frame.sequence] = error
                        self._arrived.notify_all()
                continue
            if not isinstance(message, Telemetry | Event | Log):
                with self._arrived:
                    if isinstance(message, Acknowledge):
                        self.state = message.state
                        if message.command in (SetTension.type, SetImpedance.type):
                            self._refused = message
                            continue
                    self._answers[frame.sequence] = message
                    self._arrived.notify_all()
                continue
            if isinstance(message, Telemetry):
                if self.telemetry is not None and not is_newer(message, self.telemetry.message):
                    self.stale_frames += 1
                    self.repeated += 1
                    continue
                self.repeated = 0
                self.telemetry = Received(message, now)
            if isinstance(message, Telemetry | Event):
                self.state, self.faults = message.state, message.faults
            if self.on_message is not None:
                self.on_message(Received(message, now))


def is_newer(message: Telemetry, before: Telemetry) -> bool:
    """Return whether telemetry was sent after another one, or by a module that has restarted since."""
    behind = (before.time_us - message.time_us) % CLOCK_WRAP_US
    return behind > CLOCK_WRAP_US // 2 or behind >= RESTARTED_US
