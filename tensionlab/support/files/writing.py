"""Writing files: whole or not at all, with errors in words.

A file is written under another name beside its place, and takes the place when it is complete. So whoever reads
the place finds the old file or the new one, and a full disk costs neither.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path
from typing import IO, TYPE_CHECKING

from tensionlab.errors import WriteError, optional_import
from tensionlab.support.files.reading import as_path
from tensionlab.support.operating_system import retry_while_locked

if TYPE_CHECKING:
    from filelock import BaseFileLock


PROBE_BYTES = 4096
"""So many bytes must fit beside a file's place before the work that makes the file."""
ADVICE = {
    errno.ENOSPC: "free some space, or name another place",
    errno.EDQUOT: "free some space, or name another place",
    errno.EFBIG: "free some space, or name another place",
    errno.ENOENT: "make that folder first",
    errno.ENOTDIR: "name a place in a folder",
    errno.EISDIR: "name a file",
    errno.ENAMETOOLONG: "give a shorter name",
}
"""What to do, by the system's error number; else, to name another place."""


def unwritable(path: str | PathLike[str], error: OSError) -> WriteError:
    """Return the error that says in words why a file could not be written, and what to do."""
    if isinstance(error, WriteError):
        return error
    advice = ADVICE.get(error.errno or 0, "name another place")
    return WriteError(f"{path}: cannot be written ({error.strerror or error}); {advice}")


def require_writable(path: str | PathLike[str], suffixes: Sequence[str] = ()) -> None:
    """Check that a file can be written, before the work that makes it: some bytes are written beside its place.

    It must have one of the suffixes, in lower case, if there are any; its folder must be there; and at its place
    there must be nothing other than a file that may be replaced.
    """
    if suffixes and as_path(path).suffix.lower() not in suffixes:
        what = "a name is missing" if as_path(path).name in suffixes else "unsupported format"
        raise WriteError(f"{path}: {what}; it must end in {' or '.join(suffixes)}")
    place = _place(path)
    try:
        _probe(place.parent)
    except OSError as error:
        raise unwritable(path, error) from None


def require_new(path: str | PathLike[str], what: str) -> None:
    """Check that there is nothing at a file's place, or an empty file."""
    place = as_path(path)
    if os.path.lexists(place) and not (place.is_file() and not place.stat().st_size):
        raise WriteError(f"{path}: there is something already; name a new file for {what}")


def require_folder(path: str | PathLike[str], *, parents: bool = False) -> None:
    """Check that files can be written to a folder, which need not be there yet. Nothing is made.

    With ``parents``, the folder that it is to be made in need not be there either.
    """
    folder = Path(os.path.realpath(path))
    if not parents and not os.path.lexists(folder.parent):
        raise WriteError(f"{path}: no folder {folder.parent}; make it first")
    while not os.path.lexists(folder) and folder != folder.parent:
        folder = folder.parent
    try:
        _probe(folder)
    except OSError as error:
        raise unwritable(path, error) from None


def make_folder(path: str | PathLike[str]) -> Path:
    """Make a folder, and those that it lies in, unless it is there."""
    try:
        as_path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(path, error) from None
    return as_path(path)


@contextmanager
def replacing(path: str | PathLike[str]) -> Iterator[IO[bytes]]:
    """Open a file that takes its place when the block ends, and is gone if the block fails.

    A link is followed. A file that was there before keeps its permissions. `WriteError` if the system refuses,
    here or when the block ends, or there is something other than a file to replace.
    """
    place = _place(path)
    new = _neighbour(place.parent, place.suffix)
    try:
        with new.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        if place.exists():
            new.chmod(stat.S_IMODE(place.stat().st_mode))
        retry_while_locked(lambda: new.replace(place))
    except BaseException as error:
        with suppress(OSError):
            new.unlink()
        if isinstance(error, OSError):
            raise unwritable(path, error) from None
        raise


def write_bytes(path: str | PathLike[str], content: bytes) -> None:
    """Write a file, as `replacing` does."""
    with replacing(path) as file:
        file.write(content)


def write_text(path: str | PathLike[str], text: str) -> None:
    """Write a file in UTF-8, as `replacing` does. Line ends stay as they are."""
    write_bytes(path, text.encode())


def open_stream(path: str | PathLike[str]) -> IO[bytes]:
    """Open a file that is written in its place, for what comes bit by bit and must outlive a killed process.

    What was in it is lost, but only if something can be written in its stead.
    """
    require_writable(path)
    try:
        return _place(path).open("wb")
    except OSError as error:
        raise unwritable(path, error) from None


def _place(path: str | PathLike[str]) -> Path:
    """Return where the file really is, or will be; refuse what must not be replaced."""
    place = Path(os.path.realpath(path))
    try:
        mode = place.lstat().st_mode
    except FileNotFoundError:
        if not place.parent.is_dir():
            raise WriteError(f"{path}: no folder {place.parent}; make it first") from None
        return place
    except OSError as error:
        raise unwritable(path, error) from None
    if stat.S_ISDIR(mode):
        raise WriteError(f"{path}: is a folder; name a file")
    if not stat.S_ISREG(mode):
        raise WriteError(f"{path}: is a device, a pipe or the like, which is not replaced; name a file")
    if not os.access(place, os.W_OK):
        raise WriteError(f"{path}: is there and must not be changed; name another file")
    return place


def _neighbour(folder: Path, suffix: str = "") -> Path:
    """Return a name in a folder that nothing has; it says whose it is, should a killed process leave it."""
    return folder / f".tensionlab-{secrets.token_hex(8)}{suffix}"


def _probe(folder: Path) -> None:
    """Write some bytes to a folder, and take them away."""
    new = _neighbour(folder)
    try:
        with new.open("xb") as file:
            file.write(bytes(PROBE_BYTES))
    finally:
        with suppress(OSError):
            new.unlink()


def acquire_lock(path: Path, timeout: float, extra: str) -> BaseFileLock | None:
    """Lock a file, which is made if it is not there, for this process, at whose end the system releases it.

    Returns the lock, or None if another process has it for longer than the timeout, in s. The extra of this
    package that brings filelock is for messages.
    """
    with optional_import(extra, "a lock"):
        from filelock import FileLock, Timeout
    lock = FileLock(path, thread_local=False, poll_interval=0.01)
    try:
        lock.acquire(timeout=timeout)
    except Timeout:
        return None
    return lock
