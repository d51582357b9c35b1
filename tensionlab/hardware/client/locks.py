"""Locks on links, so that one process at a time uses a module, and notes that name the process.

Locks and notes are files named after the link, in each folder that all processes of the user share
(`user_folders`): a folder that is full, or that is removed with the user's session, does not hide a lock. The
system releases the locks of a process that ends or is killed.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from tensionlab.errors import LinkError, MissingDependency
from tensionlab.hardware.client.shared_telemetry import publisher
from tensionlab.support.files.writing import acquire_lock
from tensionlab.support.operating_system import is_private, process_start, retry_while_locked, user_folders

if TYPE_CHECKING:
    from filelock import BaseFileLock

LOCK_TIMEOUT_S = 0.3
SIMULATED, MAX_SIMULATED = "sim:", 8  # URL of a module that is simulated in its process; those that others find
MAX_PROGRAM_CHARACTERS = 100  # length of a command line in messages


@dataclass(frozen=True)
class Holder:
    """Process that has a link: its number, start, and command line, and its name of the module.

    `port` and `token` are those of the telemetry that it publishes, `url` is the link.
    """

    pid: int
    started: int | None
    program: str
    module: str
    port: int | None = None
    token: str = ""
    url: str = ""

    def __str__(self) -> str:
        return f"process {self.pid} ({self.program})"


class LinkLock:
    """Lock on a link, held by this process until it is released or the process ends.

    ``module`` is the module's name, for other processes to read. A `LinkError` if another process has the link,
    which is named, or none of the user's folders can be written to.
    """

    def __init__(self, url: str, module: str = "") -> None:
        self._held: list[tuple[BaseFileLock, Path]] = []
        port, token = (None, "") if (published := publisher()) is None else (published.port, published.token)
        owner = Holder(os.getpid(), process_start(os.getpid()), program(), module, port, token, url)
        name, problems = _file_name(url), ["this user has no home"]
        for folder in user_folders():
            try:
                self._take(_make_private(folder) / name, owner)
            except LinkError:
                raise
            except OSError as error:
                problems.append(f"{error.filename or folder}: {error.strerror}")
        if not self._held:
            raise LinkError(f"{url} cannot be locked: {problems[-1]}; see that you may write there")

    def _take(self, path: Path, owner: Holder) -> None:
        """Lock a file and write its note; a `LinkError` if another process has it."""
        note = path.with_suffix(".json")
        lock = acquire_lock(path, LOCK_TIMEOUT_S, "hardware")
        if lock is None:
            self.release()
            raise LinkError(f"{owner.url} is in use by {_read(note) or 'another process'}; end that first")
        try:
            new = path.with_suffix(".new")
            new.write_text(json.dumps(asdict(owner)), encoding="utf-8")
            retry_while_locked(lambda: new.replace(note))
        except OSError:
            lock.release()
            raise
        self._held.append((lock, note))

    def release(self) -> None:
        """Release the lock; a released one may be released again."""
        while self._held:
            lock, note = self._held.pop()
            with suppress(OSError):  # a note without its lock is ignored
                retry_while_locked(partial(note.unlink, missing_ok=True))
            lock.release()


def holder(url: str, *, look_up: bool = True) -> Holder | None:
    """Return the process that has a link; None if there is none, or it left no note.

    Without ``look_up``, host names, which may take seconds to look up, find only links by the same name.
    """
    name = _file_name(url, look_up=look_up)
    return next((owner for folder in _private_folders() if (owner := _holder(folder / name))), None)


def locked_links() -> dict[str, Holder]:
    """Return the process of each link that processes of this user have, without looking up host names."""
    return {url: owner for url, owner in holders().items() if not url.startswith(SIMULATED)}


def holders() -> dict[str, Holder]:
    """Return the same with processes that simulate their modules themselves, under numbered URLs."""
    notes = [note for folder in _private_folders() for note in sorted(folder.glob("*.json"))]
    owners = [owner for note in notes if (owner := _holder(note.with_suffix(".lock"))) is not None]
    return {owner.url: owner for owner in owners}


def lock_simulated() -> LinkLock | None:
    """Return a lock that shows others a process without links; None without filelock, or if many have one."""
    for number in range(MAX_SIMULATED):
        with suppress(LinkError, MissingDependency):
            return LinkLock(f"{SIMULATED}{number}")
    return None


def _holder(path: Path) -> Holder | None:
    """Return the process that has a lock; None if it is free, or its note is of a process that has ended.

    A lock that cannot be tried counts as held.
    """
    owner = _read(path.with_suffix(".json"))
    if owner is None or process_start(owner.pid) != owner.started:
        return None
    with suppress(OSError):
        lock = acquire_lock(path, 0.0, "hardware")
        if lock is not None:
            lock.release()
            return None
    return owner


def normalised(url: str, *, look_up: bool = True) -> str:
    """Return the same URL for all that reach the same module; ``look_up`` allows to look up host names."""
    if url.startswith("socket://"):
        host, port = tcp_address(url)
        return f"socket://{_address(host, look_up)}:{port}"
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


def _address(host: str, look_up: bool) -> str:
    """Return the address of a host, or its name if that is unknown."""
    flags = 0 if look_up else socket.AI_NUMERICHOST
    with suppress(OSError, UnicodeError):
        host = str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=flags)[0][4][0])
    return "127.0.0.1" if host == "::1" else host  # as the system writes it


def _file_name(url: str, *, look_up: bool = True) -> str:
    return f"{hashlib.sha256(normalised(url, look_up=look_up).encode()).hexdigest()[:24]}.lock"


def _private_folders() -> Iterator[Path]:
    for folder in user_folders():
        with suppress(OSError):
            if is_private(folder):
                yield folder


def _make_private(folder: Path) -> Path:
    """Make a folder of locks if it is missing; a `PermissionError` if others own it or may enter it."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not is_private(folder):
        problem = "must be yours and closed to others (mode 0700); remove it, or correct that"
        raise PermissionError(errno.EPERM, problem, str(folder))
    return folder


def _read(note: Path) -> Holder | None:
    with suppress(OSError, ValueError, TypeError):
        return Holder(**json.loads(note.read_text(encoding="utf-8")))
    return None


def program() -> str:
    """Return the command line of this process, shortened."""
    called = Path(sys.argv[0]) if sys.argv and sys.argv[0] else Path("python")
    name = called.parent.name if called.name == "__main__.py" else called.name
    words = " ".join([name, *sys.argv[1:]])
    return words if len(words) <= MAX_PROGRAM_CHARACTERS else words[: MAX_PROGRAM_CHARACTERS - 1] + "…"
