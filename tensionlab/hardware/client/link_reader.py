"""Reader of links: one thread of the process for all links that the system can wait for."""

from __future__ import annotations

import os
import selectors
import socket
import sys
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

REMOVAL_TIMEOUT_S = 1.0
"""How long who closes a link waits for the reader to be done with it."""

_lock = threading.Lock()
_readers: dict[int, LinkReader] = {}  # by the number of the process: a fork has the other's, without its thread


def link_reader() -> LinkReader:
    """Return the reader of this process, started at the first call."""
    with _lock:
        if os.getpid() not in _readers:
            _readers[os.getpid()] = LinkReader()
        return _readers[os.getpid()]


class LinkReader:
    """Thread that waits for all links at once, and has each read as bytes come."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._changes: deque[Callable[[], None]] = deque()
        self._waker, woken = socket.socketpair()
        self._waker.setblocking(False)
        woken.setblocking(False)

        def wake() -> bool:
            with suppress(BlockingIOError):
                woken.recv(4096)
            while self._changes:
                self._changes.popleft()()
            return True

        self._selector.register(woken, selectors.EVENT_READ, wake)
        self._thread = threading.Thread(target=self._run, name="reader of all links", daemon=True)
        self._thread.start()

    def add(self, file: int, read: Callable[[], bool]) -> None:
        """Have `read` called whenever the file has something to be read, until it returns False."""

        def change() -> None:
            self._drop(file)  # of one that was closed by somebody else
            try:
                self._selector.register(file, selectors.EVENT_READ, read)
            except (OSError, ValueError):  # it is closed already: reading says so
                self._goes_on(read)

        self._change(change)

    def remove(self, file: int, read: Callable[[], bool]) -> None:
        """Read a file no more, from the return of this on."""

        def change() -> None:
            with suppress(KeyError, ValueError):
                if self._selector.get_key(file).data == read:
                    self._drop(file)
            done.set()

        done = threading.Event()
        if threading.current_thread() is self._thread:
            change()
        else:
            self._change(change)
            done.wait(REMOVAL_TIMEOUT_S)

    def _change(self, change: Callable[[], None]) -> None:
        self._changes.append(change)
        with suppress(BlockingIOError):  # woken already
            self._waker.send(b"\1")

    def _drop(self, file: int) -> None:
        with suppress(KeyError, ValueError):
            self._selector.unregister(file)

    def _run(self) -> None:
        while True:
            for key, _ in self._selector.select():
                if not self._goes_on(key.data):
                    self._drop(key.fd)

    def _goes_on(self, read: Callable[[], bool]) -> bool:
        """Have a link read; an error ends that link's reading alone."""
        try:
            return read()
        except BaseException:
            kind, error, trace = sys.exc_info()
            assert kind is not None
            threading.excepthook(threading.ExceptHookArgs((kind, error, trace, self._thread)))
            return False
