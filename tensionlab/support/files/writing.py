"""Writing files: whole or not at all, with errors in words.

A file is written under a temporary name in the same folder and renamed when it is complete: readers find the old
file or the new one, and a full disk costs neither.
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

PROBE_BYTES = 4096  # written and removed again before the work that makes a file
NO_SPACE = "free some space, or name another place"
ADVICE = {
    errno.ENOSPC: NO_SPACE,
    errno.EDQUOT: NO_SPACE,
    errno.EFBIG: NO_SPACE,
    errno.ENOENT: "make that folder first",
    errno.ENOTDIR: "name a place in a folder",
    errno.EISDIR: "name a file",
    errno.ENAMETOOLONG: "give a shorter name",
}


def unwritable(path: str | PathLike[str], error: OSError) -> WriteError:
    """Return the error that says why a file could not be written, and what to do."""
    if isinstance(error, WriteError):
        return error
    advice = ADVICE.get(error.errno or 0, "name another place")
    return WriteError(f"{path}: cannot be written ({error.strerror or error}); {advice}")


def require_writable(path: str | PathLike[str], suffixes: Sequence[str] = ()) -> None:
    """Check that a file can be written, before the work that makes it, by writing some bytes to its folder.

    Its name must end in one of the suffixes (lower case), if any are given.
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
    """Check that a file does not exist yet, or is empty."""
    place = as_path(path)
    if os.path.lexists(place) and not (place.is_file() and not place.stat().st_size):
        raise WriteError(f"{path}: there is something already; name a new file for {what}")


def require_folder(path: str | PathLike[str], *, parents: bool = False) -> None:
    """Check that files can be written to a folder, which need not exist yet; its parents too with ``parents``."""
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
    """Open a file that replaces the one at ``path`` when the block ends, and is removed if the block fails.

    Links are followed, permissions kept. `WriteError` if the system refuses or the path is not a file's.
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
    """Open a file that is written in place, for data that must outlive a killed process."""
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
    """Return an unused name in a folder; it names this package, should a killed process leave it."""
    return folder / f".tensionlab-{secrets.token_hex(8)}{suffix}"


def _probe(folder: Path) -> None:
    new = _neighbour(folder)
    try:
        with new.open("xb") as file:
            file.write(bytes(PROBE_BYTES))
    finally:
        with suppress(OSError):
            new.unlink()


def acquire_lock(path: Path, timeout: float, extra: str) -> BaseFileLock | None:
    """Lock a file for this process; the system releases it when the process ends.

    Return the lock, or None if another process holds it for longer than ``timeout``, in s. ``extra`` is the extra
    of this package that brings filelock.
    """
    with optional_import(extra, "a lock"):
        from filelock import FileLock, Timeout
    lock = FileLock(path, thread_local=False, poll_interval=0.01)
    try:
        lock.acquire(timeout=timeout)
    except Timeout:
        return None
    return lock
