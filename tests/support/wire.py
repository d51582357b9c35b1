"""A module in a process of its own, and a client of it, for the tests."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

import serial

from tensionlab.hardware.protocol.frames import Decoder
from tensionlab.hardware.protocol.messages import Acknowledge, Message, Ping, Pong, read


class Client:
    """One connection. `messages` holds what came and was not waited for."""

    def __init__(self, url: str) -> None:
        self.line = serial.serial_for_url(url, timeout=0.01)
        self.decoder, self.messages, self.sequence = Decoder(), [], 0

    def close(self) -> None:
        inner = getattr(self.line, "_socket", None)  # which pyserial forgets to close if the far end has gone
        self.line.close()
        if inner is not None:
            inner.close()

    def send(self, message: Message) -> int:
        self.sequence = (self.sequence + 1) % 256
        self.line.write(message.frame(self.sequence).pack())
        return self.sequence

    def take(self) -> None:
        content = self.line.read(max(self.line.in_waiting, 1))
        self.messages += [read(frame) for frame in self.decoder.feed(content)]

    def wait(self, kind: type, seconds: float = 5.0, **fields: object) -> Message:
        """The first message of a kind whose fields are these; what came before it is dropped."""
        end = time.monotonic() + seconds
        while True:
            while self.messages:
                found = self.messages.pop(0)
                if isinstance(found, kind) and all(getattr(found, key) == fields[key] for key in fields):
                    return found
            if time.monotonic() > end:
                raise TimeoutError(f"no {kind.__name__} {fields} within {seconds} s")
            self.take()

    def ask(self, message: Message, kind: type = Acknowledge) -> Message:
        self.send(message)
        return self.wait(kind)

    def ping(self) -> float:
        """Round trip in s."""
        echo = time.monotonic_ns()
        self.send(Ping(echo))
        self.wait(Pong, echo=echo)
        return 1e-9 * (time.monotonic_ns() - echo)


@contextmanager
def connected(url: str) -> Iterator[Client]:
    client = Client(url)
    try:
        yield client
    finally:
        client.close()
