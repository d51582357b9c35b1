"""Reader of links: one thread of the process for all links that the system can wait for.

Telemetry is read natively, without the interpreter, into the endpoint of each module; all else is for Python.
"""

from __future__ import annotations

import atexit
import os
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from tensionlab import _native

REMOVAL_TIMEOUT_S = 1.0  # how long who closes a link waits for the reader to be done with it

_lock = threading.Lock()
_readers: dict[int, LinkReader] = {}  # by the number of the process: a fork has the other's, without its thread


def link_reader() -> LinkReader:
    """Return the reader of this process, started at the first call."""
    with _lock:
        if os.getpid() not in _readers:
            _readers[os.getpid()] = LinkReader()
        return _readers[os.getpid()]


@atexit.register
def _end() -> None:
    """End the reader of this process: a thread in a native call must not meet the end of the interpreter."""
    if (reader := _readers.pop(os.getpid(), None)) is not None:
        reader.end()


class LinkReader:
    """Thread that waits for all links at once, and has each read as bytes come."""

    def __init__(self) -> None:
        self._native = _native.LinkReader()
        self._reads: dict[int, Callable[[], bool]] = {}
        self._endpoints: dict[int, _native.Endpoint | None] = {}  # they live as long as they are read
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
        """Have `read` called whenever the file has something to be read, until it returns False.

        What comes goes to the endpoint if there is one; `read` is called when that has messages for Python, and
        when the link is broken or at its end.
        """
        self._change(lambda: self._add(file, read, endpoint))

    def remove(self, file: int, read: Callable[[], bool]) -> None:
        """Read a file no more, from the return of this on."""

        def change() -> None:
            if self._reads.get(file) == read:
                self._drop(file)
            done.set()

        done = threading.Event()
        if threading.current_thread() is self._thread or self._ended:
            change()
        else:
            self._change(change)
            done.wait(REMOVAL_TIMEOUT_S)

    def end(self) -> None:
        """Read no link any more, and end the thread."""

        def end() -> None:
            self._ended = True

        self._change(end)
        self._thread.join(REMOVAL_TIMEOUT_S)

    def _change(self, change: Callable[[], None]) -> None:
        self._changes.append(change)
        with suppress(BlockingIOError):  # woken already
            self._waker.send(b"\1")

    def _add(self, file: int, read: Callable[[], bool], endpoint: _native.Endpoint | None) -> None:
        self._reads[file], self._endpoints[file] = read, endpoint
        self._native.add(file, endpoint)  # in place of one that was closed by somebody else

    def _drop(self, file: int) -> None:
        self._native.drop(file)
        del self._reads[file], self._endpoints[file]

    def _run(self) -> None:
        while not self._ended:
            for file in self._native.wait():
                read = self._reads.get(file)  # none if a change has just dropped it
                if read is not None and not self._goes_on(read) and self._reads.get(file) is read:
                    self._drop(file)

    def _goes_on(self, read: Callable[[], bool]) -> bool:
        """Have a link read; an error ends that link's reading alone."""
        try:
            return read()
        except BaseException:
            kind, error, trace = sys.exc_info()
            assert kind is not None
            threading.excepthook(threading.ExceptHookArgs((kind, error, trace, self._thread)))
            return False
