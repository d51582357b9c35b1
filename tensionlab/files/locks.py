"""Locks on files, held by one process at a time. The system releases those of a process that ends."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tensionlab.errors import MissingDependency

if TYPE_CHECKING:
    from filelock import BaseFileLock


def acquire(path: Path, patience: float, extra: str) -> BaseFileLock | None:
    """Lock a file, which is made if it is not there.

    Parameters
    ----------
    path : path
    patience : float
        How long to wait for somebody who holds it, in s.
    extra : str
        Of this package that brings what is needed, for messages.

    Returns
    -------
    lock or None
        To be released; None if somebody else has it for longer than that.

    Raises
    ------
    MissingDependency
        If filelock is not installed.
    OSError
        If the file cannot be written.
    """
    try:
        from filelock import FileLock, Timeout
    except ImportError as missing:
        raise MissingDependency(f'locks need filelock: pip install "tensionlab[{extra}]"') from missing
    lock = FileLock(path, thread_local=False, poll_interval=0.01)
    try:
        lock.acquire(timeout=patience)
    except Timeout:
        return None
    return lock
