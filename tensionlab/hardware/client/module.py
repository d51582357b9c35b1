"""Client of one module: sends numbered commands, and receives answers and telemetry."""

from __future__ import annotations

import random
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple, Self, TypeVar

from tensionlab import _native
from tensionlab.errors import HardwareError, LinkError, LinkTimeout, ModuleFault, ProtocolError
from tensionlab.hardware.client.links import Link, link_reader, open_link
from tensionlab.hardware.protocol import messages
from tensionlab.hardware.protocol.codes import (
    FOLLOWING_STATES,
    LATCHED_STATES,
    RELEASED_STATES,
    Calibration,
    Code,
    Fault,
    State,
    Type,
    require_name,
    require_value,
)
from tensionlab.hardware.protocol.messages import Acknowledge, Info, Message, Telemetry, WireFrame

ANSWER_TIMEOUTS_S = (0.2, 0.3, 0.45)  # wait for an answer in each try
# More tries for a bad link: before a run, at its end, and in an emergency.
PATIENT_TIMEOUTS_S = (*ANSWER_TIMEOUTS_S, *(ANSWER_TIMEOUTS_S[-1],) * 5)
SLOW_TIMEOUTS_S = (2.0, 2.0, 2.0)  # for commands that take the module long
SLOW_COMMANDS = (messages.Save, messages.Calibrate)
CLOCK_WRAP_US = 1 << 32  # where the clocks of modules wrap around
MAX_LOGS = 20
READ_TIMEOUT_S = 0.1  # wait for bytes before a thread checks whether its link is closed
NO_FILE, NO_STATE = -1, -1  # of an endpoint without one
SET_POINTS = (Type.SET_TENSION, Type.SET_IMPEDANCE)
ANSWERS = (Type.INFO, Type.PARAMETER, Type.PONG)  # if unreadable, an error of the request that waits for them

AnswerType = TypeVar("AnswerType", bound=Message)


class Received(NamedTuple):
    """Telemetry of a module, and when it came by the clock of the link, in s."""

    message: Telemetry
    time: float


def require_ready(client: ModuleClient, info: Info) -> None:
    """Refuse a module that another program has armed, that has a fault, or is not calibrated; say what to do."""
    named, url, state = f'module "{client.name}"', client.link.url, info.state
    if state in FOLLOWING_STATES:
        raise LinkError(f"{named} is {state.name}: another program has armed it; `tensionlab module stop {url}`")
    if state in LATCHED_STATES:
        raise client.fault(f"is in {state.name}: find out why, then `tensionlab module clear {url}`", state)
    if not info.calibrated:
        raise HardwareError(f"{named} is not calibrated; first `tensionlab module calibrate gain {url}`")


class ModuleClient:
    """Client of one module: commands, their answers, and telemetry.

    A thread reads all links of the process; messages of a simulated module in this process are read by each
    request and `listen`. As a context manager, it closes the link; after an error it stops the module first.

    The name is for error messages; the seed, of the first numbers of messages and sessions, is for a reproducible
    simulation.

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
        self._recorded: list[Telemetry] | None = None
        self.logs: deque[str] = deque(maxlen=MAX_LOGS)  # the module's latest lines of text
        # Sessions must differ from those of other hosts and earlier runs.
        self._random = random.SystemRandom() if seed is None else random.Random(seed)
        self._sequence = self._random.randrange(256)
        # It decodes telemetry without holding the GIL, and counts set-points and damaged frames.
        self.endpoint = _native.Endpoint(self._random.randrange(256))
        self._latest: tuple[int, Received | None] = (0, None)
        self._answers: dict[int, Message | ProtocolError] = {}
        self._refused: Acknowledge | None = None  # the latest refused set-point
        self._unreadable = 0
        self._broken: LinkError | None = None
        self._arrived = threading.Condition()
        self._closing = False
        self._reader: threading.Thread | None = None
        if self.link.lockstep:
            return
        if self.link.file is not None:
            self.endpoint.set_file(self.link.file)
            link_reader().add(self.link.file, self._read, self.endpoint)
        else:
            self._reader = threading.Thread(target=self._read_until_closed, name=f"reader of {name}", daemon=True)
            self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            with suppress(HardwareError):
                self.stop()
        self.close()

    def close(self) -> None:
        """Close the link; a module that was pulling notices, and releases its cable."""
        self._closing = True
        self.endpoint.set_file(NO_FILE)
        if not self.link.lockstep and self.link.file is not None:
            link_reader().remove(self.link.file, self._read)
        self.link.close()
        if self._reader is not None and self._reader is not threading.current_thread():
            self._reader.join(timeout=1.0)

    def command(self, command: Message, tries: tuple[float, ...] = ()) -> None:
        """Send a command and wait until it is acknowledged, for ``tries`` in s.

        A `ModuleFault` if the module refuses, with the code why; a `LinkTimeout` if it does not answer, a
        `LinkError` if the link broke; a `ProtocolError` if its answer is invalid, or of another protocol.
        """
        self.request(command, Acknowledge, tries)

    def request(self, command: Message, answer: type[AnswerType], tries: tuple[float, ...] = ()) -> AnswerType:
        """Return the answer to a command, which keeps its number when repeated; errors as those of `command`."""
        sequence: int | None = None
        tries = tries or (SLOW_TIMEOUTS_S if isinstance(command, SLOW_COMMANDS) else ANSWER_TIMEOUTS_S)
        for timeout in tries:
            sequence = self.send(command, sequence)
            end, waiting = self.link.clock() + timeout, True
            while waiting:
                if (message := self.answer(command, sequence, answer)) is not None:
                    return message
                remaining = end - self.link.clock()
                waiting = remaining > 0 and self._wait(sequence, remaining)
        raise self.no_answer(command, len(tries))

    def fault(self, problem: str, code: State | Code | Fault) -> ModuleFault:
        """Return the error of this module with a problem in words."""
        return ModuleFault(f'module "{self.name}" {problem}', self.name, code)

    def no_answer(self, command: Message, tries: int) -> LinkTimeout:
        """Return the error of a command that was sent several times without an answer."""
        return LinkTimeout(
            f'module "{self.name}" at {self.link.url} did not answer {type(command).__name__} in {tries} tries; '
            "is it on, and in range?"
        )

    def send(self, command: Message, sequence: int | None = None) -> int:
        """Send a command without waiting and return its number; sent again, it keeps its number."""
        if sequence is None:
            with self._arrived:
                if isinstance(command, messages.Arm):
                    sequence = self.endpoint.next_arm()
                else:
                    self._sequence = sequence = (self._sequence + 1) % 256
                self._answers.pop(sequence, None)
        self.link.send(command.frame(sequence).pack())
        return sequence

    def answer(self, command: Message, sequence: int, kind: type[AnswerType]) -> AnswerType | None:
        """Return the answer to a command if it has come, else None; errors as those of `command`."""
        if self._broken is not None:
            raise self._broken
        with self._arrived:
            answer = self._answers.pop(sequence, None)
        if isinstance(answer, ProtocolError):
            nonsense = "" if isinstance(answer, messages.OtherProtocolError) else "sent an invalid answer: "
            raise ProtocolError(f'module "{self.name}" {nonsense}{answer}')
        if isinstance(answer, Acknowledge):
            other_session = isinstance(command, messages.Arm) and answer.session != command.session
            if answer.command is not command.type or (answer.code is Code.OK and other_session):
                return None
            if answer.code is not Code.OK:
                refused = f"refused {type(command).__name__}: {answer.code.name} (it is {answer.state.name})"
                raise self.fault(refused, answer.code)
        return answer if isinstance(answer, kind) else None

    def listen(self, seconds: float = 0.0) -> None:
        """Let a simulated module run for some seconds and read its messages; other links are read by a thread."""
        if not self.link.lockstep or self._broken is not None:
            return
        try:
            end = self.link.clock() + seconds if seconds else 0.0
            while content := self.link.receive(end - self.link.clock() if seconds else 0.0):
                self._feed(content)
        except LinkError as error:
            self._mark_broken(error)

    def hello(self) -> Info:
        """Return the module's description of itself; errors as those of `command`."""
        return self.request(messages.Hello(), Info)

    def arm(self) -> None:
        """Have the module pull with its minimum tension, and wait for set-points of a new session.

        A stop that comes between HELLO and ARM, of whichever host, has the module refuse it.
        """
        self.command(self.new_session(self.hello()))

    def new_session(self, info: Info) -> messages.Arm:
        """Draw a session other than the module's last, and return the command that begins it."""
        while (drawn := self._random.randrange(1, 1 << 16)) == info.session:
            pass
        self.endpoint.session = drawn
        return messages.Arm(drawn, info.stops)

    def wait(self, seconds: float) -> None:
        """Let time pass by the module's link: a simulated module runs meanwhile, a real one does so anyway."""
        end = self.link.clock() + seconds
        self.listen(seconds)
        remaining = end - self.link.clock()
        if remaining > 1e-3:  # a simulated module goes by its steps
            time.sleep(remaining)

    def stop(self) -> None:
        """Have the module release its cable and be idle; a fault or an emergency stop needs `clear`."""
        self.command(messages.Stop())

    def estop(self) -> None:
        """Have the module release its cable at once, and stay so until `clear`."""
        self.command(messages.EmergencyStop())

    def clear(self) -> None:
        """Have the module leave fault or emergency stop."""
        self.command(messages.Clear())

    def calibrate(self, what: Calibration, value: float = 0.0) -> None:
        """Give the module a measured length or N/A, or have it find its motor's zero."""
        self.command(messages.Calibrate(what, value))

    def parameter(self, name: str) -> float:
        """Return the value of a parameter."""
        return self.request(messages.GetParameter(require_name(name).index), messages.ParameterValue).value

    def set_parameter(self, name: str, value: float) -> None:
        """Change a parameter until the next start, or for good with the command `Save`."""
        require_value(name, value, f'module "{self.name}"')
        self.command(messages.SetParameter(require_name(name).index, value))

    def set_tension(self, tension: float, *, brake: bool = False, ttl_ms: int = 0) -> int:
        """Command a tension, in N; return the sequence number, which telemetry repeats."""
        return self._send_set_point(messages.SetTension(self.endpoint.session, tension, brake, ttl_ms))

    def set_impedance(self, setting: messages.SetImpedance) -> int:
        """Command a spring and damper, with this session; return the sequence number."""
        return self._send_set_point(replace(setting, session=self.endpoint.session))

    def check(self) -> None:
        """Raise a `LinkError` if the link broke, a `ModuleFault` if the module refused a set-point or released."""
        if self._broken is not None:
            raise self._broken
        if self.state in RELEASED_STATES:
            faults = Fault(self.endpoint.faults)
            named = f": {faults.name or int(faults)}" if faults else ""
            raise self.fault(f"has released its cable ({self.state.name}{named})", faults or self.state)
        if (refused := self.forget_refusals()) is not None:
            raise self.fault(f"refused a set-point: {refused.code.name}", refused.code)

    def forget_refusals(self) -> Acknowledge | None:
        """Discard the refusals of set-points up to now, and return the latest."""
        with self._arrived:
            refused, self._refused = self._refused, None
            self.endpoint.needs_attention = self._broken is not None
        return refused

    @property
    def telemetry(self) -> Received | None:
        """The latest telemetry."""
        if (newer := self.endpoint.latest(self._latest[0])) is not None:
            number, payload, time = newer
            self._latest = number, Received(Telemetry.unpack(payload), time)
        return self._latest[1]

    def unchecked(self) -> tuple[Received | None, Received] | None:
        """Return the telemetry before and the latest, if that is new since this call or another check."""
        if (pair := self.endpoint.unchecked()) is None:
            return None
        previous, latest = (report and Received(Telemetry.unpack(report[0]), report[1]) for report in pair)
        assert latest is not None
        return previous, latest

    @property
    def state(self) -> State | None:
        """State by the latest message that had it."""
        number = self.endpoint.state
        return None if number == NO_STATE else State(number)

    def record(self, telemetry: list[Telemetry] | None) -> None:
        """Append all telemetry from now on to a list; None ends that."""
        self._recorded, self.endpoint.python_decodes = telemetry, telemetry is not None

    @property
    def bad_frames(self) -> int:
        """Number of frames that were damaged or could not be read."""
        return self.endpoint.bad_frames + self._unreadable

    def _send_set_point(self, message: messages.SetTension | messages.SetImpedance) -> int:
        rounds, sequence = divmod(self.endpoint.next_set_point(), 256)
        self.link.send(replace(message, rounds=rounds).frame(sequence).pack())
        return sequence

    def _wait(self, sequence: int, seconds: float) -> bool:
        """Wait for an answer; return False if nothing came in time."""
        if self.link.lockstep:
            self._feed(content := self.link.receive(seconds))
            return bool(content)
        with self._arrived:
            return self._arrived.wait_for(lambda: sequence in self._answers or self._broken is not None, seconds)

    def _read_until_closed(self) -> None:
        while not self._closing and self._read(READ_TIMEOUT_S):
            pass

    def _read(self, timeout: float = 0.0) -> bool:
        """Read the bytes that come within `timeout` s; return False if the link has broken."""
        self._store_answers()
        try:
            content = self.link.receive(timeout)
        except LinkError as error:
            self._mark_broken(error)
            return False
        self._feed(content)
        return True

    def _mark_broken(self, error: LinkError) -> None:
        with self._arrived:
            self._broken, self.endpoint.needs_attention = error, True
            self._arrived.notify_all()

    def _feed(self, content: bytes) -> None:
        if content:
            self.endpoint.feed(content, self.link.clock())
            self._store_answers()

    def _store_answers(self) -> None:
        """Decode the frames that the endpoint leaves to Python: answers, and telemetry that is recorded."""
        now = self.link.clock()
        for frame in map(WireFrame._make, self.endpoint.take_queue()):
            try:
                message = messages.read(frame)
            except ProtocolError as error:
                self._unreadable += 1
                if frame.type in ANSWERS:
                    self._store_answer(frame.sequence, error)
                continue
            if isinstance(message, Telemetry) and not self.endpoint.take(frame.payload, now):
                continue  # not newer than the latest
            if isinstance(message, Acknowledge | Info | messages.Event):
                self.endpoint.state = message.state
            if isinstance(message, messages.Event):
                self.endpoint.faults = message.faults
            if isinstance(message, Telemetry):
                if (recorded := self._recorded) is not None:
                    recorded.append(message)
            elif isinstance(message, Acknowledge) and message.command in SET_POINTS:
                with self._arrived:
                    self._refused, self.endpoint.needs_attention = message, True
            elif isinstance(message, messages.Log):
                self.logs.append(message.text)
            elif not isinstance(message, messages.Event):
                if isinstance(message, Acknowledge) and (message.command, message.code) == (Type.CLEAR, Code.OK):
                    self.endpoint.faults = 0
                self._store_answer(frame.sequence, message)

    def _store_answer(self, sequence: int, answer: Message | ProtocolError) -> None:
        with self._arrived:
            self._answers[sequence] = answer
            self._arrived.notify_all()
