"""Stores of a sweep's values: in memory, or in Zarr with a ledger, which a killed sweep goes on with.

The format is version 2 of Zarr, in which texts have a specification. Beside its arrays a store has a lock and a
ledger: a file of lines with a checksum of every file. The first line names the sweep and has the checksums of what
is there before the first value: metadata, coordinates and manifest. Then comes a line for each finished chunk,
written once its data are on disk, and at last one that says that the sweep is complete. Every line begins with a
checksum of its own, so that a line that was cut short or damaged does not count: its chunk is evaluated again.
"""

from __future__ import annotations

import glob
import hashlib
import json
import math
import os
import shutil
import uuid
from collections.abc import Container, Mapping, Set
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import SweepError, needs
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.support.files import writing
from tensionlab.support.operating_system import patiently
from tensionlab.workspace.sweep.dataset import attributes
from tensionlab.workspace.sweep.plan import Plan, Task

if TYPE_CHECKING:
    import xarray
    from filelock import BaseFileLock

MAX_MEMORY_BYTES = 2_000_000_000
"""Of a sweep that is kept in memory."""
LEDGER = ".ledger"
LOCK = ".lock"
"""Held by the process that writes to the store."""
LEDGER_FORMAT = "tensionlab sweep 1"

Checksums = Mapping[str, str | None]
"""By path in the store; None for a chunk without a file, which Zarr leaves out where all values are NaN."""


class MemoryStore:
    """Sweep in memory, with the interface of `ZarrStore`; SweepError if it is too large for that."""

    def __init__(self, plan: Plan, empty: xarray.Dataset) -> None:
        size = 8 * len(plan.metrics) * math.prod(plan.shape)
        if size > MAX_MEMORY_BYTES:
            raise SweepError(
                f"the sweep has {math.prod(plan.shape):,} values of each metric, {size / 1e9:.1f} GB: "
                "too much to keep in memory; give out, a folder DIR.zarr to write to"
            )
        self.finished: Container[int] = ()
        self._plan, self._empty = plan, empty
        self._values = np.full((len(plan.metrics), *plan.shape), np.nan)

    def write(self, task: Task, values: Floats) -> None:
        """Keep the values of one chunk, (metrics, *shape of its block)."""
        self._values[(slice(None), *task.block)] = values

    def dataset(self) -> xarray.Dataset:
        """Return the whole, once every chunk is written."""
        return self._empty.assign(
            {
                name: (self._plan.dims, values, attributes(metric))
                for (name, metric), values in zip(self._plan.metrics.items(), self._values, strict=True)
            }
        )

    def close(self) -> None:
        """Do nothing: memory holds no lock."""


class ZarrStore:
    """Zarr store that a sweep is written to, goes on with, or is opened from. One process at a time writes.

    ``finished`` holds the numbers of the chunks that it has, ``empty`` the coordinates and attributes. SweepError
    if there is something else at the path, the store of another sweep, one whose files were changed, or one that
    another process writes to; it says what differs.
    """

    def __init__(self, path: Path, plan: Plan, empty: xarray.Dataset) -> None:
        with needs("workspace", "a store"):
            import zarr
        self._path, self._chunks = path, plan.chunks
        self._lock: BaseFileLock | None = None
        if not path.exists():
            _create(path, plan, empty)
        self._metrics = list(plan.metrics)
        sweep = json.loads(empty.attrs["sweep"])
        self._ledger = _open_ledger(path, sweep)
        self.finished: Container[int] = self._ledger.verify()
        if self._ledger.complete:
            return
        self._lock = _lock(path)
        try:
            self._ledger = _open_ledger(path, sweep)  # whoever had the lock may have gone on
            self.finished = self._ledger.verify()
            self._ledger.rewrite()  # without lines that do not count
            group = zarr.open_group(path, mode="r+")
            self._arrays = [group[name] for name in plan.metrics]
        except BaseException:
            self.close()
            raise

    def write(self, task: Task, values: Floats) -> None:
        """Write the values of one chunk, and then that it is finished."""
        tile = tuple(part.start // size for part, size in zip(task.block, self._chunks, strict=True))
        files: dict[str, str | None] = {}
        for array, part in zip(self._arrays, values, strict=True):
            array[task.block] = part
            name = f"{array.basename}/{array.metadata.encode_chunk_key(tile)}"
            file = self._path / name
            if file.exists():  # Zarr leaves out chunks that are NaN all over
                with file.open("rb+") as written:
                    os.fsync(written.fileno())
            files[name] = checksum(file)
        self._ledger.add(task.number, files)

    def dataset(self) -> xarray.Dataset:
        """Complete the ledger, and open the whole; values are read when they are needed."""
        if not self._ledger.complete:
            self._ledger.finish()
        data: xarray.Dataset = provenance.import_xarray().open_zarr(self._path, chunks=None)
        ordered = {name: data[name] for name in self._metrics}  # a folder has them by the alphabet
        return data.drop_vars(list(ordered)).assign(ordered)

    def close(self) -> None:
        """Release the lock, so that others can write."""
        if self._lock is not None:
            self._lock.release()
        self._lock = None


def _lock(path: Path) -> BaseFileLock:
    """Lock a store; SweepError if another process writes to it."""
    try:
        lock = writing.acquire_lock(path / LOCK, 0.0, "workspace")
    except OSError as error:
        raise SweepError(f"{path}: cannot be written ({error.strerror}); give another place") from None
    if lock is None:
        raise SweepError(f"{path}: another sweep writes to it; wait until that has ended, or give another place")
    return lock


def _open_ledger(path: Path, sweep: dict[str, Any]) -> Ledger:
    """Return the ledger of a store; refuse what is no store of this very sweep."""
    ledger = Ledger(path)
    if ledger.sweep is None:
        if _is_sweep(path):
            raise SweepError(
                f"{path} has no ledger, which says what is complete: it is lost, or an earlier version wrote the "
                "store; give another place, or delete it"
            )
        raise SweepError(f"{path} is there and holds no sweep; give another place to write to")
    differs = [part for part, value in sweep.items() if ledger.sweep.get(part) != value]
    if differs:
        raise SweepError(
            f"{path} holds a sweep that differs in {' and '.join(differs)}; give another place, or delete it"
        )
    return ledger


def _is_sweep(path: Path) -> bool:
    """Return whether a folder has the attributes of a sweep."""
    try:
        return "sweep" in json.loads((path / ".zattrs").read_bytes())
    except (OSError, ValueError, RecursionError, TypeError):
        return False


def _create(path: Path, plan: Plan, empty: xarray.Dataset) -> None:
    """Make a store without values, under another name until it is whole."""
    import zarr

    folder = path.absolute().parent
    if not folder.is_dir():
        raise SweepError(f"no folder {folder}; make it first")
    try:
        _clear(path)
        making = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.new")
        making.mkdir()
        lock = writing.acquire_lock(making / LOCK, 1.0, "workspace")
        new = making / "store"
        empty.to_zarr(new, zarr_format=2, consolidated=False)
        group = zarr.open_group(new, mode="r+")
        for name, metric in plan.metrics.items():
            group.create_array(
                name,
                shape=plan.shape,
                chunks=plan.chunks,
                dtype="float64",
                fill_value=np.nan,
                attributes={**attributes(metric), "_ARRAY_DIMENSIONS": list(plan.dims)},
            )
        zarr.consolidate_metadata(new.as_posix())
        Ledger(new).begin(json.loads(empty.attrs["sweep"]))
        try:
            patiently(lambda: new.rename(path))
        except OSError:
            if not path.exists():  # else another sweep was quicker, and this one looks whether it is the same
                raise
        finally:
            if lock is not None:
                lock.release()  # first: Windows removes no file that is open
            shutil.rmtree(making, ignore_errors=True)
    except OSError as error:
        raise SweepError(f"{path}: cannot be made ({error.strerror}); give another place") from None


def _clear(path: Path) -> None:
    """Delete what killed processes left of this store: what has a lock that nobody holds."""
    for left in path.absolute().parent.glob(f".{glob.escape(path.name)}.*.new"):
        if (left / LOCK).exists() and (lock := writing.acquire_lock(left / LOCK, 0.0, "workspace")) is not None:
            lock.release()
            shutil.rmtree(left, ignore_errors=True)


class Ledger:
    """Ledger of a store: what it holds, and whether it is complete.

    ``sweep`` tells the sweep from every other; it is None if there is no ledger that can be read.
    """

    def __init__(self, store: Path) -> None:
        self._store = store
        self.sweep: Mapping[str, Any] | None = None
        self.complete = False
        self._base: Checksums = {}
        self._chunks: dict[int, Checksums] = {}
        try:
            lines = (store / LEDGER).read_bytes().split(b"\n")[:-1]  # a last one without an end was cut short
        except OSError:
            return
        for content in filter(None, map(_content, lines)):
            self.complete = content.get("complete") == len(self._chunks)
            if content.get("format") == LEDGER_FORMAT:
                self.sweep, self._base = content["sweep"], content["files"]
            elif "chunk" in content:
                self._chunks[content["chunk"]] = content["files"]

    def begin(self, sweep: Mapping[str, Any]) -> None:
        """Write the first line, with the checksums of what the store holds so far."""
        inside = (path for path in self._store.rglob("*") if path.is_file() and path.name not in (LEDGER, LOCK))
        self.sweep = sweep
        self._base = {path.relative_to(self._store).as_posix(): checksum(path) for path in inside}
        self.rewrite()

    def add(self, number: int, files: Checksums) -> None:
        """Add the line of a finished chunk, whose files must be on disk."""
        self._chunks[number] = files
        with (self._store / LEDGER).open("ab") as ledger:
            ledger.write(_line({"chunk": number, "files": files}))
            ledger.flush()
            os.fsync(ledger.fileno())

    def finish(self) -> None:
        """Write that the sweep is complete."""
        self.complete = True
        self.rewrite()

    def rewrite(self) -> None:
        """Write the whole anew, at once or not at all."""
        new = self._store / f"{LEDGER}.new"
        with new.open("wb") as ledger:
            ledger.write(_line({"format": LEDGER_FORMAT, "sweep": self.sweep, "files": self._base}))
            ledger.writelines(_line({"chunk": n, "files": files}) for n, files in sorted(self._chunks.items()))
            if self.complete:
                ledger.write(_line({"complete": len(self._chunks)}))
            ledger.flush()
            os.fsync(ledger.fileno())
        patiently(lambda: new.replace(self._store / LEDGER))

    def verify(self) -> Set[int]:
        """Return the numbers of the chunks that are finished, whose files are all there, and unchanged.

        SweepError names a file that is missing or was changed. Values that are missing are no error: their chunk
        is not finished any more.
        """
        for name, expected in self._base.items():
            found = checksum(self._store / name)
            if found != expected:
                what = "is missing" if found is None else "was changed since the sweep wrote it"
                raise SweepError(f"{self._store / name} {what}; delete {self._store}, or give another place")
        for number, files in list(self._chunks.items()):
            for name, expected in files.items():
                found = checksum(self._store / name)
                if found is None and expected is not None:
                    self._chunks.pop(number, None)
                    self.complete = False
                elif found != expected:
                    raise SweepError(
                        f"{self._store / name} was changed since the sweep wrote it; delete this file, "
                        "and its values are evaluated again"
                    )
        return self._chunks.keys()


def checksum(path: Path) -> str | None:
    """Return the checksum of a file; None if there is none."""
    try:
        return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise SweepError(f"{path} cannot be read ({error.strerror}); give another place") from None


def _line(content: Mapping[str, Any]) -> bytes:
    text = json.dumps(content).encode()
    return hashlib.blake2b(text, digest_size=8).hexdigest().encode() + b" " + text + b"\n"


def _content(line: bytes) -> dict[str, Any] | None:
    """Return the content of a line; None if it is not as it was written."""
    mark, _, text = line.partition(b" ")
    if hashlib.blake2b(text, digest_size=8).hexdigest().encode() != mark:
        return None
    content: dict[str, Any] = json.loads(text)
    return content
