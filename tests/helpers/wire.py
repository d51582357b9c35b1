"""A client of one module that sees each message, and telemetry of a module, for the tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tensionlab.hardware.client.links import Link, connect
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit, State
from tensionlab.hardware.protocol.messages import Acknowledge, Decoder, Message, Ping, Pong, Telemetry, read


def telemetry(time_us: int = 0, **changes: object) -> Telemetry:
    """Return what a module that follows set-points reports, but for some changes."""
    usual = {"state": State.RUNNING, "faults": Fault(0), "limit": Limit.NONE, "sequence": 0, "tension": 2.0}
    usual |= {"current": 0.75, "length": 1.0, "speed": 0.0, "supply": 12.0, "winding": 40, "bearable": 6.125}
    usual |= {"brake": BrakeState.OPEN, "bad_frames": 0, "lost_frames": 0, "longest_step_us": 250}
    return Telemetry(time_us, **(usual | changes))


class Client:
    """One connection. `messages` holds what came and was not waited for."""

    def __init__(self, link: Link) -> None:
        self.link = link
        self.decoder, self.messages, self.sequence = Decoder(), [], 0

    def close(self) -> None:
        self.link.close()

    def send(self, message: Message) -> int:
        self.sequence = (self.sequence + 1) % 256
        self.link.send(message.frame(self.sequence).pack())
        return self.sequence

    def take(self, seconds: float = 0.01) -> None:
        content = self.link.receive(seconds)
        self.messages += [read(frame) for frame in self.decoder.feed(content)]

    def wait(self, kind: type, seconds: float = 60.0, **fields: object) -> Message:
        """The first message of a kind whose fields are these; what came before it is dropped."""
        end = self.link.clock() + seconds
        while True:
            while self.messages:
                found = self.messages.pop(0)
                if isinstance(found, kind) and all(getattr(found, key) == fields[key] for key in fields):
                    return found
            if self.link.clock() > end:
                raise TimeoutError(f"no {kind.__name__} {fields} within {seconds} s")
            self.take()

    def ask(self, message: Message, kind: type = Acknowledge) -> Message:
        self.send(message)
        return self.wait(kind)

    def ping(self) -> float:
        """Round trip in s."""
        began = self.link.clock()
        echo = int(1e9 * began)
        self.send(Ping(echo))
        self.wait(Pong, echo=echo)
        return self.link.clock() - began


@contextmanager
def connected(where: str | Link) -> Iterator[Client]:
    """A client at a URL or a link, which is closed at the end."""
    client = Client(connect(where) if isinstance(where, str) else where)
    try:
        yield client
    finally:
        client.close()
