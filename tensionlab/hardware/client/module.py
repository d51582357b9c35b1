"""Client of one module: numbered commands out, a method for each; answers and telemetry in."""

from __future__ import annotations

import logging
import math
import random
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Generic, Self, TypeVar

from tensionlab import _native
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault, ProtocolError
from tensionlab.hardware.client.link_reader import link_reader
from tensionlab.hardware.client.links import Link, open_link
from tensionlab.hardware.client.shared_telemetry import Report, publisher
from tensionlab.hardware.protocol import messages
from tensionlab.hardware.protocol.codes import (
    FOLLOWING_STATES,
    LATCHED_STATES,
    RELEASED_STATES,
    Calibration,
    Code,
    Fault,
    State,
)
from tensionlab.hardware.protocol.frames import WireFrame
from tensionlab.hardware.protocol.messages import Acknowledge, Message, Telemetry
from tensionlab.hardware.protocol.parameters import PARAMETERS, require_name, require_value

ANSWER_TIMEOUTS_S = (0.2, 0.3, 0.45)  # how long each try waits for an answer
# More tries: a bad link is no reason to give up before a run, at its end, or in an emergency.
PATIENT_TIMEOUTS_S = (*ANSWER_TIMEOUTS_S, *(ANSWER_TIMEOUTS_S[-1],) * 5)
CLOCK_WRAP_US = 1 << 32  # where the clocks of modules wrap around
READ_TIMEOUT_S = 0.1  # how long the reader waits before it checks whether to end
SAVE_TIMEOUTS_S = (2.0, 2.0, 2.0)  # how long each try waits for an answer to a command that takes the module long
NO_FILE, NO_STATE = -1, -1  # those of an endpoint that has none
SET_POINTS = (messages.SetTension.type, messages.SetImpedance.type)
UNREQUESTED = (Telemetry, messages.Event, messages.Log)  # messages that a module sends by itself
# Frames whose damage is an error of the request that waits for them.
ANSWERS = (messages.Info.type, messages.ParameterValue.type, messages.Pong.type)

AnswerType = TypeVar("AnswerType", bound=Message)
MessageType_co = TypeVar("MessageType_co", bound=Message, covariant=True)


@dataclass(frozen=True)
class Received(Generic[MessageType_co]):
    """Unrequested message of a module, and when it came by the clock of the link, in s."""

    message: MessageType_co
    time: float


def answers(found: Acknowledge, command: Message) -> bool:
    """Tell whether an acknowledgement is of this command: of its type, and where it arms a module, its session."""
    if found.command is not command.type:
        return False
    return not (isinstance(command, messages.Arm) and found.code is Code.OK and found.session != command.session)


class ModuleClient:
    """Client of one module: commands, their answers, and messages that the module sends by itself.

    A thread reads all links of the process: what ``on_message`` does must not take long. Of a simulated module in
    this process, messages are read by each request and `listen`. It is a context manager, which closes the link;
    after an error it stops the module first.

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
    endpoint
        What the reader of links needs of it, without Python: latest telemetry, state, numbers of set-points.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.hardware import ModuleClient, World
    >>> from tensionlab.hardware.simulation.links import SimulatedLink
    >>> simulated = World(tl.load_rig("floor-3")).modules[0]
    >>> client = ModuleClient("floor-1", SimulatedLink(simulated))  # or the URL of a real one
    >>> client.arm()
    >>> client.set_tension(2.0) > 0  # its sequence number
    True
    >>> client.stop()
    """

    def __init__(self, name: str, link: Link | str, seed: int | None = None) -> None:
        self.name = name
        self.link = open_link(link, name) if isinstance(link, str) else link
        self._arm_repeated = False
        self._on_message: Callable[[Received[Message]], None] | None = None
        # Sessions are to be unlike those of any other host and of any earlier run.
        self._random = random.SystemRandom() if seed is None else random.Random(seed)
        self._sequence = self._random.randrange(256)
        self.endpoint = _native.Endpoint(self._random.randrange(256))
        self._heard: tuple[int, Received[Telemetry] | None] = (0, None)
        self._answers: dict[int, Message | ProtocolError] = {}
        self._refused: Acknowledge | None = None  # the latest refused set-point
        self._unreadable = 0
        self._broken: LinkError | None = None
        self._arrived = threading.Condition()
        self._closing = False
        self._reader: threading.Thread | None = None
        if not self.link.lockstep:
            if self.link.file is not None:
                direct = getattr(self.link, "direct", False)
                if direct:
                    self.endpoint.set_file(self.link.file)
                link_reader().add(self.link.file, self._read, self.endpoint if direct else None)
            else:
                self._reader = threading.Thread(target=self._read_on, name=f"reader of {name}", daemon=True)
                self._reader.start()
            if (published := publisher()) is not None:
                published.reports[self.link.url] = self.report

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

    def close(self) -> None:
        """Close the link; a module that was pulling notices, and releases its cable."""
        self._closing = True
        self.endpoint.set_file(NO_FILE)
        if not self.link.lockstep and (published := publisher()) is not None:
            published.reports.pop(self.link.url, None)
        if not self.link.lockstep and self.link.file is not None:
            link_reader().remove(self.link.file, self._read)
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
            if isinstance(command, messages.Arm):
                sequence, self._arm_repeated = self.endpoint.next_arm(), False
            else:
                sequence = self._next()
            with self._arrived:
                self._answers.pop(sequence, None)
            self.link.send(command.frame(sequence).pack())
            return sequence
        self._arm_repeated |= isinstance(command, messages.Arm)
        self.link.send(command.frame(sequence).pack())
        return sequence

    def answer(self, command: Message, sequence: int, kind: type[AnswerType]) -> AnswerType | None:
        """Return the answer to a command if it has come, else None; errors as those of `command`."""
        if self._broken is not None:
            raise self._broken
        with self._arrived:
            found = self._answers.pop(sequence, None)
        if isinstance(found, messages.OtherProtocolError):
            raise ProtocolError(f'module "{self.name}" {found}')
        if isinstance(found, ProtocolError):
            raise ProtocolError(f'module "{self.name}" answered what makes no sense: {found}')
        if isinstance(found, Acknowledge) and not answers(found, command):
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

    def send_set_point(self, message: messages.SetTension | messages.SetImpedance) -> int:
        """Send a set-point, which is not answered, and return its number."""
        rounds, sequence = divmod(self.endpoint.next_set_point(), 256)
        self.link.send(replace(message, rounds=rounds).frame(sequence).pack())
        return sequence

    def listen(self, seconds: float = 0.0) -> None:
        """Let a simulated module run for some seconds and read its messages; others are read all the time."""
        if not self.link.lockstep or self._broken is not None:
            return
        try:
            end = self.link.clock() + seconds if seconds else 0.0
            while content := self.link.receive(end - self.link.clock() if seconds else 0.0):
                self._take(content)
        except LinkError as error:
            self._broke(error)

    def hello(self) -> messages.Info:
        """Return the module's description of itself; errors as those of `command`."""
        return self.request(messages.Hello(), messages.Info)

    def require_ready(self, info: messages.Info) -> None:
        """Refuse a module that somebody else has armed, that has a fault, or is not calibrated; say what to do."""
        if info.state in FOLLOWING_STATES:
            raise LinkError(
                f'module "{self.name}" is {info.state.name}: somebody else has it armed; stop it there, or with '
                f"`tensionlab module stop {self.link.url}`"
            )
        if info.state in LATCHED_STATES:
            raise ModuleFault(
                f'module "{self.name}" is in {info.state.name}: find out why, then '
                f"`tensionlab module clear {self.link.url}`",
                self.name,
                info.state,
            )
        if not info.calibrated:
            raise HardwareError(
                f'module "{self.name}" is not calibrated, and can\'t be armed: '
                f"`tensionlab module calibrate gain {self.link.url}`"
            )

    def ping(self) -> tuple[float, int]:
        """Return the round-trip time of a message, in s, and the module's clock, in us."""
        began = self.link.clock()
        pong = self.request(messages.Ping(self._random.getrandbits(64)), messages.Pong)
        return self.link.clock() - began, pong.time_us

    def arm(self) -> None:
        """Make the module pull with the minimum tension, and wait for set-points of a new session."""
        try:
            self.command(self.new_session())
        except ModuleFault as error:
            if not self.session_was_used(error):
                raise
            self.command(self.new_session())

    def new_session(self) -> messages.Arm:
        """Draw a session, which a module accepts only once, and return the command that begins it."""
        self.endpoint.session = self._random.randrange(1, 1 << 16)
        return messages.Arm(self.session)

    def session_was_used(self, error: HardwareError) -> bool:
        """Tell whether arming failed because an earlier host drew the same session: one in 65,535 does.

        Not where the command was repeated: it may have armed the module, and been stopped since by somebody else.
        """
        return isinstance(error, ModuleFault) and error.code is Code.BAD_SESSION and not self._arm_repeated

    def wait(self, seconds: float) -> None:
        """Let time pass by the module's link: a simulated module runs meanwhile, a real one does so anyway."""
        end = self.link.clock() + seconds
        self.listen(seconds)
        left = end - self.link.clock()
        if left > 1e-3:  # a simulated module goes by its steps
            time.sleep(left)

    def stop(self) -> None:
        """Make the module release its cable and be idle; a fault or an emergency stop needs `clear`."""
        self.command(messages.Stop())

    def estop(self) -> None:
        """Make the module release its cable at once, and stay so until `clear`."""
        self.command(messages.EmergencyStop())

    def clear(self) -> None:
        """Make the module leave fault or emergency stop."""
        self.command(messages.Clear())
        self.endpoint.faults = 0

    def telemetry_every(self, period_ms: int) -> None:
        """Set the period of telemetry, in ms; 0 for none."""
        self.command(messages.ConfigureTelemetry(period_ms))

    def calibrate(self, what: Calibration, value: float = 0.0) -> None:
        """Give the module a measured length or N/A, or make it find its motor's zero."""
        self.command(messages.Calibrate(what, value), SAVE_TIMEOUTS_S)

    def parameter(self, name: str) -> float:
        """Return the value of a parameter."""
        return self.request(messages.GetParameter(require_name(name).index), messages.ParameterValue).value

    def set_parameter(self, name: str, value: float) -> None:
        """Change a parameter until the next start, or for good with `save`."""
        require_value(name, value, f'module "{self.name}"')
        self.command(messages.SetParameter(PARAMETERS[name].index, value))

    def save(self) -> None:
        """Store the module's parameters for good."""
        self.command(messages.Save(), SAVE_TIMEOUTS_S)

    def set_tension(self, tension: float, *, brake: bool = False, ttl_ms: int = 0) -> int:
        """Command a tension, in N; return the sequence number, which telemetry repeats."""
        return self.send_set_point(messages.SetTension(self.session, tension, brake, ttl_ms))

    def set_impedance(self, setting: messages.SetImpedance) -> int:
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
        if (refused := self.forget_refusals()) is not None:
            raise ModuleFault(
                f'module "{self.name}" refused a set-point: {refused.code.name}', self.name, refused.code
            )

    def forget_refusals(self) -> Acknowledge | None:
        """Discard the refusals of set-points up to now, and return the latest."""
        with self._arrived:
            refused, self._refused = self._refused, None
            self.endpoint.needs_attention = self._broken is not None
        return refused

    @property
    def session(self) -> int:
        """Session of the last `arm`."""
        return self.endpoint.session

    @property
    def telemetry(self) -> Received[Telemetry] | None:
        """The latest telemetry."""
        newer = self.endpoint.latest(self._heard[0])
        if newer is not None:
            number, payload, time = newer
            self._heard = number, Received(Telemetry.unpack(payload), time)
        return self._heard[1]

    def unchecked(self) -> tuple[Received[Telemetry] | None, Received[Telemetry]] | None:
        """Return the telemetry before and the latest, if that is new since this call or another check."""
        found = self.endpoint.unchecked()
        if found is None:
            return None
        before, latest = found
        return (
            None if before is None else Received(Telemetry.unpack(before[0]), before[1]),
            Received(Telemetry.unpack(latest[0]), latest[1]),
        )

    @property
    def stale_frames(self) -> int:
        """Number of telemetry frames that were ignored: they were no newer than the latest."""
        return self.endpoint.stale

    @property
    def repeated(self) -> int:
        """Number of those since the latest."""
        return self.endpoint.repeated

    @property
    def state(self) -> State | None:
        """State by the latest message that had it."""
        number = self.endpoint.state
        return None if number == NO_STATE else State(number)

    @property
    def faults(self) -> Fault:
        """Faults by the latest message that had them."""
        return Fault(self.endpoint.faults)

    @property
    def followed_since_arm(self) -> bool:
        """Whether telemetry has reported, in ARMED or RUNNING, the latest ARM's number or a set-point since."""
        return self.endpoint.followed

    @property
    def on_message(self) -> Callable[[Received[Message]], None] | None:
        """Called with each unrequested message, if set."""
        return self._on_message

    @on_message.setter
    def on_message(self, callback: Callable[[Received[Message]], None] | None) -> None:
        self._on_message = callback
        self.endpoint.python_decodes = callback is not None

    @property
    def age(self) -> float:
        """Time since the latest telemetry came, in s; infinite before the first."""
        heard = self.telemetry
        return math.inf if heard is None else self.link.clock() - heard.time

    def report(self) -> Report:
        """Return what other processes may know of the module."""
        heard = self.telemetry
        telemetry = None if heard is None else heard.message
        return Report(self.link.url, self.name, telemetry, self.age, self.bad_frames)

    @property
    def bad_frames(self) -> int:
        """Number of frames that were damaged or could not be read."""
        return self.endpoint.bad_frames + self._unreadable

    def _wait(self, sequence: int, seconds: float) -> bool:
        """Wait for an answer; return False if nothing came in time."""
        if self.link.lockstep:
            content = self.link.receive(seconds)
            self._take(content)
            return bool(content)
        with self._arrived:
            return self._arrived.wait_for(lambda: sequence in self._answers or self._broken is not None, seconds)

    def _next(self) -> int:
        with self._arrived:
            self._sequence = (self._sequence + 1) % 256
            return self._sequence

    def _read_on(self) -> None:
        """Read a link that the system cannot wait for, until it ends."""
        while not self._closing and self._read(READ_TIMEOUT_S):
            pass

    def _read(self, timeout: float = 0.0) -> bool:
        """Read what has come, or comes in so many s; False if the link has broken."""
        self._take_queue()
        try:
            content = self.link.receive(timeout)
        except LinkError as error:
            self._broke(error)
            return False
        self._take(content)
        return True

    def _broke(self, error: LinkError) -> None:
        with self._arrived:
            self._broken, self.endpoint.needs_attention = error, True
            self._arrived.notify_all()

    def _take(self, content: bytes) -> None:
        """Decode received bytes."""
        if not content:
            return
        self.endpoint.feed(content, self.link.clock())
        self._take_queue()

    def _take_queue(self) -> None:
        """Take what the endpoint leaves to Python: answers for those who wait, the rest for `on_message`."""
        now = self.link.clock()
        for frame in map(WireFrame._make, self.endpoint.take_queue()):
            try:
                message = messages.read(frame)
            except ProtocolError as error:
                self._unreadable += 1
                if frame.type in ANSWERS:
                    self._keep({frame.sequence: error})
                continue
            if not isinstance(message, UNREQUESTED):
                if isinstance(message, Acknowledge | messages.Info):
                    self.endpoint.state = message.state
                if isinstance(message, Acknowledge) and message.command in SET_POINTS:
                    with self._arrived:
                        self._refused, self.endpoint.needs_attention = message, True
                else:
                    self._keep({frame.sequence: message})
                continue
            if isinstance(message, Telemetry) and not self.endpoint.take(frame.payload, now):
                continue
            if isinstance(message, messages.Event):
                self.endpoint.state, self.endpoint.faults = message.state, message.faults
            if self._on_message is not None:
                self._call(self._on_message, Received(message, now))

    def _call(self, callback: Callable[[Received[Message]], None], received: Received[Message]) -> None:
        """Call back; what a callback raises must not end the thread that reads this link, and others."""
        try:
            callback(received)
        except Exception:
            logging.getLogger(__name__).exception('on_message of module "%s"', self.name)

    def _keep(self, answers: Mapping[int, Message | ProtocolError]) -> None:
        """Keep answers, by their numbers, for those who wait for them."""
        with self._arrived:
            self._answers.update(answers)
            self._arrived.notify_all()
