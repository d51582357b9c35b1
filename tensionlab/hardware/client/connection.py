"""A conversation with a module: messages out, with their numbers; answers and telemetry in."""

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
"""How long each try waits for an answer, in s."""
RESTARTED_US = 1_000_000
"""A clock of a module that has gone back by so much, in us, has started anew."""
CLOCK_WRAP = 1 << 32
"""Where the clocks of modules, in us, begin anew."""
LISTEN = 0.1
"""The reader looks up so often, in s, when nothing comes."""
ANSWERS = (Type.INFO, Type.PARAMETER, Type.PONG)
"""What makes no sense among these is an error of who waits for it."""

AnswerType = TypeVar("AnswerType", bound=Message)
MessageType_co = TypeVar("MessageType_co", bound=Message, covariant=True)


@dataclass(frozen=True)
class Received(Generic[MessageType_co]):
    """What a module has said without being asked, and when.

    Attributes
    ----------
    message : Telemetry, Event or Log
    time : float
        When it came, by the clock of the link, in s.
    """

    message: MessageType_co
    time: float


class Connection:
    """Talk with one module: any command, its answer, and what the module says by itself.

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
    telemetry : Received or None
        The latest, and when it came.
    stale_frames : int
        Telemetry that was no newer than what was there: repeated, or overtaken on its way. It is left alone.
    repeated : int
        How much of that has come since the latest.
    state : State or None
        As the latest message had it.
    faults : Fault
        As the latest telemetry or event had them.
    on_message : callable or None
        Hears what the module says without being asked.
    """

    def __init__(self, name: str, link: Link | str) -> None:
        self.name = name
        self.link = open_link(link) if isinstance(link, str) else link
        self.telemetry: Received[Telemetry] | None = None
        self.stale_frames = self.repeated = 0
        self.state: State | None = None
        self.faults = Fault(0)
        self.on_message: Callable[[Received[Message]], None] | None = None
        self._decoder = Decoder()
        self._sequence = random.randrange(256)
        self._set_point = self._armed = random.randrange(256)
        self._listener: Protocol1Listener | None = None
        self._answers: dict[int, Message | ProtocolError] = {}
        self._refused: Acknowledge | None = None  # a set-point: the latest
        self._strange = 0
        self._broken: LinkError | None = None
        self._news = threading.Condition()
        self._closing = False
        self._reader: threading.Thread | None = None
        if not self.link.lockstep:
            self._reader = threading.Thread(target=self._read, name=f"reader of {name}", daemon=True)
            self._reader.start()

    def close(self) -> None:
        """Close the link. A module that was pulling notices, and lets go by itself."""
        self._closing = True
        self.link.close()
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(timeout=1.0)

    def command(self, command: Message, tries: tuple[float, ...] = ANSWER_TIMEOUTS_S) -> None:
        """Have a command carried out.

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
        """What does the module answer? Errors as those of `command`. A repeated command has the same number."""
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
        """Send a command without waiting; returns its number. Sent again, it keeps the number it had."""
        if sequence is None:
            sequence = self._next_set_point() if isinstance(command, Arm) else self._next()
            if isinstance(command, Arm):
                self._armed = sequence
            with self._news:
                self._answers.pop(sequence, None)
            self.link.send(command.frame(sequence).pack())
            return sequence
        # Nobody answered: because the module speaks protocol 1?
        self._listener = self._listener or Protocol1Listener()
        frame = command.frame(sequence)
        self.link.send(frame.pack() + repeated_in_protocol_1(frame))
        return sequence

    def answer(self, command: Message, sequence: int, kind: type[AnswerType]) -> AnswerType | None:
        """Return what has come in answer to a command, None if nothing yet; errors as those of `command`."""
        if self._broken is not None:
            raise self._broken
        with self._news:
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
        """Make the error of a command that was sent so many times."""
        return LinkTimeout(
            f'module "{self.name}" at {self.link.url} did not answer {type(command).__name__} in {tries} tries; '
            "is it on, and in range?"
        )

    def send_set_point(self, message: SetTension | SetImpedance) -> int:
        """Send a set-point, which nobody answers; returns its number."""
        sequence = self._next_set_point()
        self.link.send(message.frame(sequence).pack())
        return sequence

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

    @property
    def reports_since_arm(self) -> bool:
        """Whether the latest telemetry was sent after the latest ARM, by the set-point that it reports."""
        if self.telemetry is None:
            return False
        since = (self.telemetry.message.sequence - self._armed) % 256
        return since <= (self._set_point - self._armed) % 256

    @property
    def bad_frames(self) -> int:
        """How many frames came damaged, or said what nobody understands?"""
        return self._decoder.bad_frames + self._strange

    def _wait(self, sequence: int, seconds: float) -> bool:
        """Wait for an answer, for so long at most; False if nothing came."""
        if self._reader is None:
            content = self.link.receive(seconds)
            self._take(content)
            return bool(content)
        with self._news:
            return self._news.wait_for(lambda: sequence in self._answers or self._broken is not None, seconds)

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
        if self._listener is not None:
            with self._news:
                self._answers |= self._listener.feed(content)
                self._news.notify_all()
        for frame in self._decoder.feed(content):
            try:
                message = read(frame)
            except ProtocolError as error:
                self._strange += 1
                if frame.type in ANSWERS:
                    with self._news:
                        self._answers[frame.sequence] = error
                        self._news.notify_all()
                continue
            if not isinstance(message, Telemetry | Event | Log):
                with self._news:
                    if isinstance(message, Acknowledge):
                        self.state = message.state
                        if message.command in (SetTension.type, SetImpedance.type):
                            self._refused = message
                            continue
                    self._answers[frame.sequence] = message
                    self._news.notify_all()
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
    """Return whether telemetry was sent after another one, or by a module that has started anew since."""
    behind = (before.time_us - message.time_us) % CLOCK_WRAP
    return behind > CLOCK_WRAP // 2 or behind >= RESTARTED_US
