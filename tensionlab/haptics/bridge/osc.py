"""The same over OSC (Open Sound Control 1.0, UDP), for what speaks that: nothing is answered.

::

    /body/hand x y z [qx qy qz qw]        where a body is, in m
    /effect/NAME KIND [parameter value]*  what the hand is to feel; a vector takes so many numbers
    /effect/NAME                          no more of it
    /stop                                 end the run

What comes in one bundle is so at the same time: that of its tag, if it has one. What a datagram asks for is taken
as a whole or not at all; addresses that are none of these are left out.
"""

from __future__ import annotations

import logging
import re
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from pydantic import ValidationError

from tensionlab.errors import EffectError, HardwareError, ProtocolError
from tensionlab.files.reading import brief
from tensionlab.haptics.bridge.budget import Budget
from tensionlab.haptics.bridge.client_state import Mailbox
from tensionlab.haptics.bridge.command import SILENCE_S, Commander, FrameRefused
from tensionlab.haptics.bridge.messages import Frame, reason_of
from tensionlab.haptics.bridge.osc_packet import OscMessage, read_packet
from tensionlab.haptics.effects import EFFECTS
from tensionlab.haptics.effects.parameters import Many, bounds

ADDRESS = re.compile(r"/stop|/(body|effect)/[^/]+")
LARGEST_DATAGRAM = 65_536
LOOK_S = 0.25
"""How often the thread looks whether it is over, in s, where nothing comes."""
PAUSE_S = 0.02
"""How long nothing is read after what is too much, in s."""
DROPPED_AT_ONCE = 1000
"""Datagrams that are thrown away then, at most."""
WAITING_BYTES = 65_536
"""Of datagrams that have not been read yet, with what the system needs for each."""
SUMMARY_S = 5.0
"""How often it is said what was ignored, in s."""


class Complaints:
    """Says why something is ignored: the first of each kind at once, then how many more there were.

    Parameters
    ----------
    say : callable
        Hears one line.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._known: set[str] = set()
        self._more: Counter[str] = Counter()
        self._since = time.monotonic()

    def add(self, kind: str, why: str, count: int = 1) -> None:
        """Note that something was ignored: its kind, one of a few, and why."""
        if kind in self._known:
            self._more[kind] += count
            return
        self._known.add(kind)
        self._say(f"OSC: {kind} ignored: {why}")

    def summarise(self, *, now: bool = False) -> None:
        """Say how many more there were, if it is time to."""
        if self._more and (now or time.monotonic() > self._since + SUMMARY_S):
            counted = ", ".join(f"{count} x {kind}" for kind, count in sorted(self._more.items()))
            self._say(f"OSC: ignored since then: {counted}")
            self._more.clear()
            self._since = time.monotonic()


class OscDoor:
    """Puts what comes over UDP into a mailbox, by a thread of its own. A context manager.

    All that one machine sends is one client's, which commands like any other: see `Command`.

    Parameters
    ----------
    mailbox : Mailbox
    host, port : str, int
        Where to listen; port 0 takes a free one.
    refused : callable
        Hears why messages came to nothing; a line for each kind, and sums.

    Attributes
    ----------
    port : int

    Raises
    ------
    HardwareError
        If it cannot listen there.
    """

    def __init__(self, mailbox: Mailbox, host: str, port: int, refused: Callable[[str], None]) -> None:
        self._mailbox, self._complaints, self._budget = mailbox, Complaints(refused), Budget()
        self._bodies: dict[str, dict[str, Any]] = {}
        self._effects: dict[str, dict[str, Any]] = {}
        self._commander: Commander | None = None
        self._machine, self._latest = "", 0.0
        self._over = False
        try:
            family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, WAITING_BYTES)
            self._socket.bind(address)
        except OSError as error:
            raise HardwareError(f"OSC cannot listen at {host}, port {port}: {error.strerror}") from None
        self._socket.settimeout(LOOK_S)
        self.port = int(self._socket.getsockname()[1])
        self._thread = threading.Thread(target=self._listen, name="OSC", daemon=True)

    def __enter__(self) -> Self:
        """Listen."""
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop listening."""
        self._over = True
        self._thread.join()
        self._socket.close()
        self._complaints.summarise(now=True)

    def _listen(self) -> None:
        while not self._over:
            self._complaints.summarise()
            try:
                data, address = self._socket.recvfrom(LARGEST_DATAGRAM)
            except OSError:  # nothing has come, or the network says that something sent before did not arrive
                continue
            now, began = time.monotonic(), time.thread_time()
            if why := self._budget.refuses(len(data), now):
                self._complaints.add("too much", why)
                self._drop()
                continue
            self._take(data, str(address[0]), now)
            self._budget.worked(time.thread_time() - began, now)

    def _drop(self) -> None:
        """Throw away what has come meanwhile, without reading it."""
        time.sleep(PAUSE_S)
        self._socket.setblocking(False)
        try:
            for _ in range(DROPPED_AT_ONCE):
                self._socket.recvfrom(LARGEST_DATAGRAM)
                self._complaints.add("too much", "")
        except OSError:  # that was all
            pass
        finally:
            self._socket.settimeout(LOOK_S)

    def _take(self, data: bytes, machine: str, now: float) -> None:
        """Take a datagram, or say why not."""
        try:
            commander = self._known(machine, now)
            if commander is None:
                self._mailbox.command.require_free(now)
            packet = read_packet(data)
            if known := self._without_unknown(packet.messages):
                commander = commander or self._begin(machine, now)
                self._put(known, now if packet.time is None else packet.time, now, commander)
        except ProtocolError as error:
            self._complaints.add("malformed datagrams", str(error))
        except FrameRefused as error:
            self._complaints.add("clients that do not command", str(error))
        except (ValidationError, EffectError) as error:
            self._complaints.add("messages that cannot be", reason_of(error))
        except Exception as error:  # one datagram must not end the thread for all that come
            logging.getLogger(__name__).exception("a datagram from %s", machine)
            self._complaints.add("messages that cannot be", f"{type(error).__name__}: {error}")

    def _known(self, machine: str, now: float) -> Commander | None:
        """Return this machine as who commands, or did; one that was sent away may come back after a silence."""
        mine = self._commander
        if mine is None or machine != self._machine:
            return None
        latest, self._latest = self._latest, now
        return None if mine.dismissed and now - latest >= SILENCE_S else mine

    def _begin(self, machine: str, now: float) -> Commander:
        """Let this machine command."""
        self._commander = self._mailbox.command.take(f"OSC from {machine}", now, lambda why: None)
        self._machine, self._latest = machine, now
        self._bodies, self._effects = {}, {}
        return self._commander

    def _without_unknown(self, messages: list[OscMessage]) -> list[OscMessage]:
        """Leave out, and tell of, what is for no known address."""
        known = [message for message in messages if ADDRESS.fullmatch(message.address)]
        for message in messages:
            if message not in known:
                there = "there are /body/NAME, /effect/NAME and /stop"
                self._complaints.add("unknown addresses", f"no address {brief(message.address)}; {there}")
        return known

    def _put(self, messages: list[OscMessage], when: float, now: float, commander: Commander) -> None:
        """Take the messages of one datagram as one frame."""
        if any(message.address == "/stop" for message in messages):
            self._mailbox.stop(now, commander)
            return
        bodies, effects = dict(self._bodies), dict(self._effects)
        for message in messages:
            _note(message, bodies, effects)
        frame = {"time": when, "bodies": bodies, "effects": effects}
        self._mailbox.put(Frame.model_validate(frame), now, commander)
        self._bodies, self._effects = bodies, effects


def _note(message: OscMessage, bodies: dict[str, Any], effects: dict[str, Any]) -> None:
    """Note what a message says of a body or an effect."""
    _, what, name = message.address.split("/")
    values = message.values
    if what == "body":
        bodies[name] = {"position": values[:3], "rotation": values[3:] or None}
    elif values:
        effects[name] = {**_parameters(name, values), "kind": values[0]}
    else:
        effects.pop(name, None)


def _parameters(effect: str, values: list[Any]) -> dict[str, Any]:
    """Return words, each followed by its number or numbers, as parameters; the first word is the kind."""
    lists = [
        name for name, bound in bounds(EFFECTS.get(str(values[0]), object)).items() if isinstance(bound, Many)
    ]
    found: dict[str, list[float]] = {}
    name = ""
    for value in values[1:]:
        if isinstance(value, str):
            name = value
            found[name] = []
        elif name:
            found[name].append(value)
        else:
            raise EffectError(f"effect {effect!r}: a number, {value}, without a parameter before it")
    return {
        name: numbers[0] if len(numbers) == 1 and name not in lists else tuple(numbers)
        for name, numbers in found.items()
    }
