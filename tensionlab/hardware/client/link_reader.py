"""Thread that reads all links with a file descriptor.

Telemetry is decoded natively, without holding the GIL, into the endpoint of each module; the rest is for Python.
"""

from __future__ import annotations

import atexit
import os
import socket
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from tensionlab import _native

REMOVAL_TIMEOUT_S = 1.0  # longest wait for the thread as a link is closed

_lock = threading.Lock()
_readers: dict[int, LinkReader] = {}  # by process number: a fork inherits the object without its thread


def link_reader() -> LinkReader:
    """Return the reader of this process, started at the first call."""
    with _lock:
        if os.getpid() not in _readers:
            _readers[os.getpid()] = LinkReader()
        return _readers[os.getpid()]


@atexit.register
def _end() -> None:
    """End the thread of this process: the interpreter must not end during a native call."""
    if (reader := _readers.pop(os.getpid(), None)) is not None:
        reader.end()


class LinkReader:
    """Thread that waits for bytes of all links, and reads each link as they come."""

    def __init__(self) -> None:
        self._native = _native.LinkReader()
        # By file descriptor; endpoints live as long as they are read.
        self._links: dict[int, tuple[Callable[[], bool], _native.Endpoint | None]] = {}
        self._changes: deque[Callable[[], None]] = deque()
        self._ended = False
        self._waker, woken = socket.socketpair()
        self._waker.setblocking(False)
        woken.setblocking(False)

        def wake() -> bool:
            with suppress(BlockingIOError):
                woken.recv(4096)
            while self._changes:
                self._changes.popleft()()
            return True

        self._add(woken.fileno(), wake, None)
        self._thread = threading.Thread(target=self._run, name="reader of all links", daemon=True)
        self._thread.start()

    def add(self, file: int, read: Callable[[], bool], endpoint: _native.Endpoint | None = None) -> None:
        """Feed bytes from a file descriptor to an endpoint, until `read` returns False.

        `read` is called when the endpoint has messages for Python, and when the link is broken or at its end;
        without an endpoint, whenever there are bytes.
        """
        self._change(lambda: self._add(file, read, endpoint))

    def remove(self, file: int, read: Callable[[], bool]) -> None:
        """Stop reading a file before this returns."""

        def change() -> None:
            self._drop(file, read)
            done.set()

        done = threading.Event()
        if threading.current_thread() is self._thread or self._ended:
            change()
        else:
            self._change(change)
            done.wait(REMOVAL_TIMEOUT_S)

    def end(self) -> None:
        """Stop reading all links, and end the thread."""
        self._change(lambda: setattr(self, "_ended", True))
        self._thread.join(REMOVAL_TIMEOUT_S)

    def _change(self, change: Callable[[], None]) -> None:
        self._changes.append(change)
        with suppress(BlockingIOError):  # woken already
            self._waker.send(b"\1")

    def _add(self, file: int, read: Callable[[], bool], endpoint: _native.Endpoint | None) -> None:
        self._links[file] = read, endpoint
        self._native.add(file, endpoint)  # in place of one that was closed elsewhere

    def _drop(self, file: int, read: Callable[[], bool]) -> None:
        """Stop reading a file, unless another link has its number now."""
        if self._links.get(file, (None, None))[0] == read:
            self._native.drop(file)
            del self._links[file]

    def _run(self) -> None:
        while not self._ended:
            for file in self._native.wait():
                read, _ = self._links.get(file, (None, None))
                if read is None:  # a change has just dropped it
                    continue
                again = False
                try:
                    again = read()
                except BaseException as error:  # which ends the reading of this link only
                    threading.excepthook(
                        threading.ExceptHookArgs((type(error), error, error.__traceback__, self._thread))
                    )
                if not again:
                    self._drop(file, read)
