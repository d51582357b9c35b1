"""Where the values of a sweep go: into memory, or into a Zarr store that a killed sweep goes on with.

Beside its arrays a store has a ledger, `tensionlab.workspace.sweep.ledger`, and a lock. The format is version 2 of
Zarr, in which texts have a specification.
"""

from __future__ import annotations

import glob
import json
import math
import os
import shutil
import uuid
from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import MissingDependency, SweepError
from tensionlab.files import writing
from tensionlab.workspace.sweep import dataset as labels
from tensionlab.workspace.sweep.ledger import LOCK, Ledger, checksum
from tensionlab.workspace.sweep.plan import Plan, Task

if TYPE_CHECKING:
    import xarray
    from filelock import BaseFileLock

LARGEST = 2_000_000_000
"""Bytes of the largest sweep that is kept in memory."""


class Sink(Protocol):
    """Where values go; ``finished`` holds the numbers of the chunks that it has already."""

    finished: Container[int]

    def write(self, task: Task, values: Floats) -> None:
        """Keep the values of one chunk, (measures, *shape of its block)."""

    def dataset(self) -> xarray.Dataset:
        """Give the whole back, once every chunk is written."""

    def close(self) -> None:
        """Let go of what is held while values are written."""


class Memory:
    """Keeps a sweep in memory.

    Raises
    ------
    SweepError
        If it is too large for that.
    """

    def __init__(self, plan: Plan, bare: xarray.Dataset) -> None:
        size = 8 * len(plan.measures) * math.prod(plan.shape)
        if size > LARGEST:
            raise SweepError(
                f"the sweep has {math.prod(plan.shape):,} values of each measure, {size / 1e9:.1f} GB: "
                "too much to keep in memory; give out, a folder DIR.zarr to write to"
            )
        self.finished: Container[int] = ()
        self._plan, self._bare = plan, bare
        self._values = np.full((len(plan.measures), *plan.shape), np.nan)

    def write(self, task: Task, values: Floats) -> None:
        """Keep the values of one chunk."""
        self._values[(slice(None), *task.block)] = values

    def dataset(self) -> xarray.Dataset:
        """Give the whole back."""
        return self._bare.assign(
            {
                name: (self._plan.dims, values, labels.attributes(measure))
                for (name, measure), values in zip(self._plan.measures.items(), self._values, strict=True)
            }
        )

    def close(self) -> None:
        """Nothing is held."""


class Store:
    """Writes a sweep to a Zarr store, goes on with one, or opens a finished one. One process at a time writes.

    Parameters
    ----------
    path : path
        Of the store.
    plan : Plan
        Of the sweep.
    bare : Dataset
        Its coordinates and attributes.

    Raises
    ------
    MissingDependency
        If zarr or filelock is not installed.
    SweepError
        If there is something else at the path, the store of another sweep, one whose files were changed, or one
        that another process writes to; it says what differs.
    """

    def __init__(self, path: Path, plan: Plan, bare: xarray.Dataset) -> None:
        try:
            import zarr
        except ImportError as error:
            raise MissingDependency('a store needs zarr: pip install "tensionlab[workspace]"') from error
        self._path, self._chunks = path, plan.chunks
        self._lock: BaseFileLock | None = None
        if not path.exists():
            _create(path, plan, bare)
        sweep = json.loads(bare.attrs["sweep"])
        self._ledger = _opened(path, sweep)
        self.finished: Container[int] = self._ledger.verify()
        if self._ledger.complete:
            return
        self._lock = _locked(path)
        try:
            self._ledger = _opened(path, sweep)  # whoever had the lock may have gone on
            self.finished = self._ledger.verify()
            self._ledger.rewrite()  # without lines that do not count
            group = zarr.open_group(path, mode="r+")
            self._arrays = [group[name] for name in plan.measures]
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
        """Say that the sweep is complete, and open the whole; values are read when they are asked for."""
        import xarray

        if not self._ledger.complete:
            self._ledger.finish()
        data: xarray.Dataset = xarray.open_zarr(self._path, chunks=None)
        return data

    def close(self) -> None:
        """Let others write."""
        if self._lock is not None:
            self._lock.release()
        self._lock = None


def _locked(path: Path) -> BaseFileLock:
    """Lock a store, or say that somebody else writes to it."""
    try:
        lock = writing.acquire_lock(path / LOCK, 0.0, "workspace")
    except OSError as error:
        raise SweepError(f"{path}: cannot be written ({error.strerror}); give another place") from None
    if lock is None:
        raise SweepError(f"{path}: another sweep writes to it; wait until that has ended, or give another place")
    return lock


def _opened(path: Path, wanted: dict[str, Any]) -> Ledger:
    """Read the ledger of a store, and refuse what is no store of this very sweep."""
    ledger = Ledger(path)
    if ledger.sweep is None:
        if _is_sweep(path):
            raise SweepError(
                f"{path} has no ledger, which says what is complete: it is lost, or an earlier version wrote the "
                "store; give another place, or delete it"
            )
        raise SweepError(f"{path} is there and holds no sweep; give another place to write to")
    differs = [part for part, value in wanted.items() if ledger.sweep.get(part) != value]
    if differs:
        raise SweepError(
            f"{path} holds a sweep that differs in {' and '.join(differs)}; give another place, or delete it"
        )
    return ledger


def _is_sweep(path: Path) -> bool:
    """Tell whether a folder has the attributes of a sweep."""
    try:
        return "sweep" in json.loads((path / ".zattrs").read_bytes())
    except (OSError, ValueError, RecursionError, TypeError):
        return False


def _create(path: Path, plan: Plan, bare: xarray.Dataset) -> None:
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
        bare.to_zarr(new, zarr_format=2, consolidated=False)
        group = zarr.open_group(new, mode="r+")
        for name, measure in plan.measures.items():
            group.create_array(
                name,
                shape=plan.shape,
                chunks=plan.chunks,
                dtype="float64",
                fill_value=np.nan,
                attributes={**labels.attributes(measure), "_ARRAY_DIMENSIONS": list(plan.dims)},
            )
        zarr.consolidate_metadata(new.as_posix())
        Ledger(new).begin(json.loads(bare.attrs["sweep"]))
        try:
            new.rename(path)
        except OSError:
            if not path.exists():  # else another sweep was quicker, and this one looks whether it is the same
                raise
        finally:
            shutil.rmtree(making, ignore_errors=True)
            if lock is not None:
                lock.release()
    except OSError as error:
        raise SweepError(f"{path}: cannot be made ({error.strerror}); give another place") from None


def _clear(path: Path) -> None:
    """Delete what processes left that were killed while they made this store: nobody holds its lock."""
    for left in path.absolute().parent.glob(f".{glob.escape(path.name)}.*.new"):
        if (left / LOCK).exists() and (lock := writing.acquire_lock(left / LOCK, 0.0, "workspace")) is not None:
            shutil.rmtree(left, ignore_errors=True)
            lock.release()
