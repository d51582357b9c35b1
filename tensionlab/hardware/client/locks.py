"""Locks on links, so that one process at a time uses a module, and notes of which process that is.

Locks and notes lie in a folder of the user's, named after the link. The system releases the locks of a process
that ends, however it ends, so nothing has to be cleared up after one that was killed.
"""

from __future__ import annotations

import hashlib
import ipaddress
import json
import os
import socket
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from tensionlab.errors import LinkError
from tensionlab.files.writing import acquire_lock
from tensionlab.hardware.client.shared_telemetry import publisher
from tensionlab.operating_system import is_private, patiently, user

if TYPE_CHECKING:
    from filelock import BaseFileLock

LOCK_TIMEOUT_S = 0.3
MAX_PROGRAM_CHARACTERS = 100
"""Of a command line in messages."""


@dataclass(frozen=True)
class Holder:
    """Process that has a lock: its number, the program as it was called, and where it publishes telemetry."""

    pid: int
    program: str
    port: int | None = None
    token: str = ""

    def __str__(self) -> str:
        return f"process {self.pid} ({self.program})"


class LinkLock:
    """Lock on a link, held by this process until it is released or the process ends.

    A `LinkError` names the process that has it already, and what that runs.
    """

    def __init__(self, url: str) -> None:
        path = _path(url)
        self._note = path.with_suffix(".json")
        self._lock = _locked(path, LOCK_TIMEOUT_S)
        if self._lock is None:
            raise LinkError(f"{url} is in use by {_read(self._note) or 'another process'}; end that first")
        content = {"pid": os.getpid(), "program": program(), "url": url}
        if (published := publisher()) is not None:
            content |= {"port": published.port, "token": published.token}
        new = path.with_suffix(".new")
        new.write_text(json.dumps(content), encoding="utf-8")
        patiently(lambda: new.replace(self._note))

    def release(self) -> None:
        """Release the lock; a released one may be released again."""
        if self._lock is not None:
            with suppress(OSError):  # of a free link, a note names nobody
                patiently(lambda: self._note.unlink(missing_ok=True))
            self._lock.release()
        self._lock = None


def holder(url: str) -> Holder | None:
    """Return the process that has a link; None if there is none, or it left no note."""
    path = _path(url)
    lock = _locked(path, 0.0)
    if lock is None:
        return _read(path.with_suffix(".json"))
    lock.release()
    return None


def locked_links() -> dict[str, Holder]:
    """Return the links that processes of this user have, and the process of each."""
    found = {}
    for note in sorted(_folder().glob("*.json")):
        with suppress(OSError, ValueError, KeyError):
            url = str(json.loads(note.read_text(encoding="utf-8"))["url"])
            who = holder(url)
            if who is not None:
                found[url] = who
    return found


def normalised(url: str) -> str:
    """Return one URL for all those that reach the same module."""
    if url.startswith("socket://"):
        host, port = tcp_address(url)
        return f"socket://{_address(host)}:{port}"
    if url.startswith("bt://"):
        address, _, channel = url.removeprefix("bt://").partition("/")
        return f"bt://{address.upper()}/{channel or 1}"
    if url.startswith("/"):
        return str(Path(url).resolve()).replace("/dev/tty.", "/dev/cu.", 1)  # macOS has each port by two names
    return url.upper()


def tcp_address(url: str) -> tuple[str, int]:
    """Return host and port of a URL such as ``socket://[::1]:4001``; a `LinkError` if it has none."""
    with suppress(ValueError):
        parts = urlsplit(url)
        if parts.hostname and parts.port:
            return parts.hostname, parts.port
    raise LinkError(f"{url}: give a host and a port from 1 to 65535, such as socket://127.0.0.1:4001")


def _address(host: str) -> str:
    """Return the address of a host, or its name if it is not known."""
    with suppress(OSError, UnicodeError):
        host = str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0])
    with suppress(ValueError):
        if ipaddress.ip_address(host) == ipaddress.ip_address("::1"):
            return "127.0.0.1"
    return host


def _locked(path: Path, timeout: float) -> BaseFileLock | None:
    """Lock a file; return None if another process still has it after the timeout, in s."""
    try:
        return acquire_lock(path, timeout, "hardware")
    except OSError as error:
        raise LinkError(f"{path}: cannot be locked: {error.strerror}; see that you may write there") from None


def _path(url: str) -> Path:
    """Return the lock file of a link."""
    return _folder() / f"{hashlib.sha256(normalised(url).encode()).hexdigest()[:24]}.lock"


def _folder() -> Path:
    """Return the folder of this user's locks, made if it is missing; nobody else may write into it."""
    folder = Path(tempfile.gettempdir()) / f"tensionlab-{user()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        private = is_private(folder)
    except OSError as error:
        raise LinkError(f"{folder}: no folder for locks of modules: {error.strerror}; make it possible") from None
    if not private:
        raise LinkError(f"{folder}: must be yours and closed to others (mode 0700); remove it, or correct that")
    return folder


def _read(note: Path) -> Holder | None:
    """Return the process that a note names; None if it cannot be read."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        content = json.loads(note.read_text(encoding="utf-8"))
        return Holder(int(content["pid"]), str(content["program"]), content.get("port"), content.get("token", ""))
    return None


def program() -> str:
    """Return the command line of this process, shortened."""
    called = Path(sys.argv[0]) if sys.argv and sys.argv[0] else Path("python")
    name = called.parent.name if called.name == "__main__.py" else called.name
    words = " ".join([name, *sys.argv[1:]])
    return words if len(words) <= MAX_PROGRAM_CHARACTERS else words[: MAX_PROGRAM_CHARACTERS - 1] + "…"
