"""Who has a module now? One process at a time: a lock of the system's on each link, and a note of who holds it.

Locks and notes lie in a folder of the user's, named after the link. The system lets go of the locks of a process
that ends, however it ends, so that nothing has to be cleared up after one that was killed.
"""

from __future__ import annotations

import getpass
import hashlib
import ipaddress
import json
import os
import signal
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

if TYPE_CHECKING:
    from filelock import BaseFileLock

ESTOP_SIGNAL: signal.Signals = getattr(signal, "SIGUSR1", signal.SIGTERM)
"""What tells a process that holds modules to stop them all at once. Who does not expect it ends by it, and so do
its links: then the modules let go by themselves."""
PATIENCE = 0.3
"""How long, in s, to wait for somebody who is just letting go."""
LONGEST = 100
"""Characters of a command line that messages repeat."""


@dataclass(frozen=True)
class Holder:
    """Which process has a module?

    Attributes
    ----------
    pid : int
        Its number.
    program : str
        What it runs, as it was called.
    """

    pid: int
    program: str

    def __str__(self) -> str:
        return f"process {self.pid} ({self.program})"


class LinkLock:
    """The right of this process to a link, until it is released or the process ends.

    Parameters
    ----------
    url : str
        Of the link.

    Raises
    ------
    LinkError
        If somebody has it; names the process and what it runs.
    MissingDependency
        If filelock is not installed.
    """

    def __init__(self, url: str) -> None:
        path = _path(url)
        self._note = path.with_suffix(".json")
        self._lock = _locked(path, PATIENCE)
        if self._lock is None:
            raise LinkError(f"{url} is in use by {_read(self._note) or 'another process'}; end that first")
        content = {"pid": os.getpid(), "program": _program(), "url": url}
        new = path.with_suffix(".new")
        new.write_text(json.dumps(content), encoding="utf-8")
        new.replace(self._note)

    def release(self) -> None:
        """Let others have the link; once is enough."""
        if self._lock is not None:
            self._note.unlink(missing_ok=True)
            self._lock.release()
        self._lock = None


def holder(url: str) -> Holder | None:
    """Which process has this link now? None if nobody has, or it does not say."""
    path = _path(url)
    lock = _locked(path, 0.0)
    if lock is None:
        return _read(path.with_suffix(".json"))
    lock.release()
    return None


def locked_links() -> dict[str, Holder]:
    """Which links do processes of this user have now, and which process has each?"""
    found = {}
    for note in sorted(_folder().glob("*.json")):
        with suppress(OSError, ValueError, KeyError):
            url = str(json.loads(note.read_text(encoding="utf-8"))["url"])
            who = holder(url)
            if who is not None:
                found[url] = who
    return found


def normalised(url: str) -> str:
    """Which of the URLs that reach the same module stands for all of them?"""
    if url.startswith("socket://"):
        parts = urlsplit(url)
        return f"socket://{_address(parts.hostname or '')}:{parts.port}"
    if url.startswith("bt://"):
        address, _, channel = url.removeprefix("bt://").partition("/")
        return f"bt://{address.upper()}/{channel or 1}"
    if url.startswith("/"):
        return str(Path(url).resolve()).replace("/dev/tty.", "/dev/cu.", 1)  # macOS has each port by two names
    return url.upper()


def _address(host: str) -> str:
    """Which number has a host? Its name if nobody knows."""
    with suppress(OSError):
        host = str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0])
    with suppress(ValueError):
        if ipaddress.ip_address(host) == ipaddress.ip_address("::1"):
            return "127.0.0.1"
    return host


def _locked(path: Path, patience: float) -> BaseFileLock | None:
    """The lock of a link, taken; None if somebody else has it for longer than that, in s."""
    try:
        return acquire_lock(path, patience, "hardware")
    except OSError as error:
        raise LinkError(f"{path}: cannot be locked: {error.strerror}; see that you may write there") from None


def _path(url: str) -> Path:
    """Where is the lock of a link?"""
    return _folder() / f"{hashlib.sha256(normalised(url).encode()).hexdigest()[:24]}.lock"


def _folder() -> Path:
    """Which folder has this user's locks? Made if it is not there; nobody else may write into it."""
    user = os.getuid() if hasattr(os, "getuid") else getpass.getuser()
    folder = Path(tempfile.gettempdir()) / f"tensionlab-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise LinkError(f"{folder}: no folder for locks of modules: {error.strerror}; make it possible") from None
    if hasattr(os, "getuid") and (found.st_uid != os.getuid() or found.st_mode & 0o077):
        raise LinkError(f"{folder}: must be yours and closed to others (mode 0700); remove it, or correct that")
    return folder


def _read(note: Path) -> Holder | None:
    """What does a note say? None if there is none that can be read."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        content = json.loads(note.read_text(encoding="utf-8"))
        return Holder(int(content["pid"]), str(content["program"]))
    return None


def _program() -> str:
    """What does this process run, as short as one can recognise it?"""
    called = Path(sys.argv[0]) if sys.argv and sys.argv[0] else Path("python")
    name = called.parent.name if called.name == "__main__.py" else called.name
    words = " ".join([name, *sys.argv[1:]])
    return words if len(words) <= LONGEST else words[: LONGEST - 1] + "…"
