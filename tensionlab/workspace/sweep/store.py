"""Stores of a sweep's values: arrays in memory, or a Zarr store, in which an interrupted sweep is resumed.

A chunk is finished once every metric has its file, which Zarr writes whole or not at all. Each file carries a
checksum (CRC-32C), which Zarr checks when it is read. A store has a path, or the URL of a file system of fsspec,
such as an object store.
"""

from __future__ import annotations

import json
import math
import shutil
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import (
    MAX_MESSAGE_CHARACTERS,
    MissingDependency,
    SweepError,
    TensionlabError,
    optional_import,
)
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.support.files import writing
from tensionlab.workspace.sweep.dataset import attributes
from tensionlab.workspace.sweep.plan import ChunkTask, Plan

if TYPE_CHECKING:
    import xarray
    from filelock import BaseFileLock

MAX_MEMORY_BYTES = 2_000_000_000  # largest sweep that is kept in memory


class MemoryStore:
    """Sweep in memory, with the interface of `ZarrStore`; SweepError if it is too large for that."""

    def __init__(self, plan: Plan, empty: xarray.Dataset) -> None:
        size = 8 * len(plan.metrics) * math.prod(plan.shape)
        if size > MAX_MEMORY_BYTES:
            advice = "too much to keep in memory; give out, a folder DIR.zarr to write to"
            raise SweepError(f"the sweep has {math.prod(plan.shape):,} poses, {size / 1e9:.1f} GB: {advice}")
        self.missing: Sequence[int] = range(math.prod(plan.tiles))
        self._plan, self._empty = plan, empty
        self._values = np.empty((len(plan.metrics), *plan.shape))

    def task(self, number: int) -> Any:
        """Return the task that evaluates the chunk of a number."""
        return self._plan.task(number)

    def write(self, task: ChunkTask, values: Floats) -> None:
        """Store the values of one chunk, (metrics, *shape of its block)."""
        self._values[(slice(None), *task.block)] = values

    def dataset(self) -> xarray.Dataset:
        """Return the whole, once every chunk is written."""
        variables = zip(self._plan.metrics, self._values, strict=True)
        return self._empty.assign({m.name: (self._plan.dims, values, attributes(m)) for m, values in variables})

    def close(self) -> None:
        """Do nothing: memory has no lock."""


@dataclass(frozen=True, eq=False)
class WritingTask:
    """Chunk that is written where it is evaluated, so that its values pass through no other process."""

    url: str
    task: ChunkTask
    arrays: tuple[Any, ...]

    def evaluate(self) -> None:
        """Evaluate the chunk, and write its values."""
        values = self.task.evaluate()
        with _explain_access(self.url):
            for array, part in zip(self.arrays, values, strict=True):
                array[self.task.block] = part


class ZarrStore:
    """Zarr store that a sweep is written to, resumed in, or opened from.

    ``missing`` are the numbers of the chunks that are not finished. SweepError says what differs if the place
    holds something else, the store of another sweep, a damaged one, one that another process writes to, or one
    that the disk has no space for; or why a URL cannot be used.

    One process at a time writes to a path. At a URL, the threads or workers that evaluate chunks write them, and
    there is no lock: two calls of one sweep do the same work, and write the same.
    """

    def __init__(self, place: str | PathLike[str], plan: Plan, empty: xarray.Dataset) -> None:
        with optional_import("workspace", "a store"):
            import fsspec
            import zarr
        self._place = place if isinstance(place, str) and "://" in place else Path(place)
        self._plan, self._identity = plan, json.loads(empty.attrs["sweep"])
        self._lock: BaseFileLock | None = None
        with _explain_access(self._place):
            self._files, self._root = fsspec.url_to_fs(self._place)
            self.missing: Sequence[int] = self._find_missing()
        if not self.missing:
            return
        try:
            if isinstance(self._place, Path):
                self._reserve(self._place)
            with _explain_access(self._place):
                if not self._files.exists(self._root):
                    _create(self._place, plan, empty, self._files, self._root)
                self.missing = self._find_missing()  # another process may have continued before the lock was free
                with _explain_damage(self._place):
                    group: Any = zarr.open_group(self._place, mode="r+")
                    every_chunk = {"write_empty_chunks": True}  # a chunk without a file is not finished
                    self._arrays = tuple(group[metric.name].with_config(every_chunk) for metric in plan.metrics)
        except OSError as error:
            self.close()
            raise SweepError(f"{place}: cannot be written ({error.strerror}); give another place") from None
        except BaseException:
            self.close()
            raise

    def _reserve(self, path: Path) -> None:
        """Check that the disk has space, and take the lock."""
        folder = path.absolute().parent
        if not folder.is_dir():
            raise SweepError(f"no folder {folder}; make it first")
        chunk = 8 * len(self._plan.metrics) * math.prod(self._plan.chunks)
        needed = chunk * len(self.missing)  # never much larger compressed
        if needed > (free := shutil.disk_usage(folder).free):
            sizes = f"may take {needed / 1e9:,.1f} GB, and {free / 1e9:,.1f} GB are free"
            raise SweepError(f"{path}: the sweep {sizes}; give another place, or fewer poses")
        self._lock = writing.acquire_lock(path.with_name(f".{path.name}.lock"), 0.0, "workspace")
        if self._lock is None:
            raise SweepError(f"{path}: another sweep writes to it; wait until it ends, or give another place")

    def _find_missing(self) -> Sequence[int]:
        """Return the numbers of the chunks of which some metric has no file; refuse the store of another sweep."""
        self._files.invalidate_cache()  # of lists, which Zarr's own connection does not renew
        if not self._files.exists(self._root):
            return range(math.prod(self._plan.tiles))
        with _explain_damage(self._place):
            _require_same(self._place, self._identity)
            files = set(self._files.find(self._root))
            folders = [f"{self._root}/{metric.name}/c" for metric in self._plan.metrics]
            keys = ("/".join(map(str, tile)) for tile in np.ndindex(*self._plan.tiles))
            return [
                number
                for number, key in enumerate(keys)
                if not all(f"{folder}/{key}" in files for folder in folders)
            ]

    def task(self, number: int) -> Any:
        """Return the task that evaluates the chunk of a number, and at a URL writes it."""
        task = self._plan.task(number)
        return task if isinstance(self._place, Path) else WritingTask(self._place, task, self._arrays)

    def write(self, task: ChunkTask | WritingTask, values: Floats | None) -> None:
        """Write the values of one chunk, unless the task did."""
        if isinstance(task, ChunkTask) and values is not None:
            for array, part in zip(self._arrays, values, strict=True):
                array[task.block] = part

    def dataset(self) -> xarray.Dataset:
        """Open the whole; values are read when they are needed."""
        if self.missing and not isinstance(self._place, Path) and self._find_missing():
            raise SweepError(f"{self._place}: the workers' chunks are not there; give one that all of them see")
        with _explain_damage(self._place):
            data: xarray.Dataset = provenance.import_xarray().open_zarr(self._place, chunks=None)
        ordered = {metric.name: data[metric.name] for metric in self._plan.metrics}  # a folder sorts them by name
        return data.drop_vars(list(ordered)).assign(ordered)

    def close(self) -> None:
        """Release the lock, so that others can write."""
        if self._lock is not None:
            with suppress(OSError):  # Windows removes no file that is open
                Path(self._lock.lock_file).unlink()
            self._lock.release()
        self._lock = None


def _create(place: str | Path, plan: Plan, empty: xarray.Dataset, files: Any, root: str) -> None:
    """Make a store without values: complete before it has its name, or at a URL its root's metadata."""
    import zarr
    from zarr.codecs import BloscCodec, Crc32cCodec
    from zarr.errors import ZarrUserWarning

    codecs: Any = (BloscCodec(cname="lz4", shuffle="shuffle"), Crc32cCodec())  # half the time of the default, Zstd
    # Texts of variable length are the only ones that the format specifies.
    texts = {name: label.astype(object) for name, label in empty.coords.items() if label.dtype.kind == "U"}
    labels = empty.assign_coords(texts)
    parent, name = (place.absolute().parent, place.name) if isinstance(place, Path) else (None, "sweep")
    with tempfile.TemporaryDirectory(prefix=f".{name}.", dir=parent) as making:
        new = Path(making) / "store"
        encoding = {name: {"compressors": codecs} for name in labels.variables}
        labels.to_zarr(new, zarr_format=3, consolidated=False, encoding=encoding)
        group = zarr.open_group(new, mode="r+")
        for metric in plan.metrics:
            group.create_array(
                metric.name,
                shape=plan.shape,
                chunks=plan.chunks,
                dtype="float64",
                fill_value=np.nan,
                compressors=codecs,
                dimension_names=plan.dims,
                attributes=attributes(metric),
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ZarrUserWarning)  # xarray and zarr-python read it; others need not
            zarr.consolidate_metadata(new.as_posix())
        if isinstance(place, Path):
            new.rename(place)
            return
        written = [file for file in new.rglob("*") if file.is_file()]
        for file in sorted(written, key=lambda file: len(file.parts), reverse=True):
            files.pipe_file(f"{root}/{file.relative_to(new).as_posix()}", file.read_bytes())


def _require_same(path: str | Path, sweep: dict[str, Any]) -> None:
    """Refuse a path that holds no sweep, or another one."""
    import zarr
    from zarr.errors import ContainsArrayError, GroupNotFoundError

    try:
        held = json.loads(str(zarr.open_group(path, mode="r").attrs["sweep"]))
    except (GroupNotFoundError, ContainsArrayError, NotADirectoryError, KeyError):
        raise SweepError(f"{path} is there and holds no sweep; give another place to write to") from None
    if differs := [part for part in sweep if held.get(part) != sweep[part]]:
        raise SweepError(f"{path} holds a sweep that differs in {' and '.join(differs)}; give another place")


@contextmanager
def _explain_access(place: str | Path) -> Iterator[None]:
    """Turn what the file system of a URL raises into a TensionlabError; they share no class of errors."""
    try:
        yield
    except TensionlabError:
        raise
    except Exception as error:
        if isinstance(place, Path):
            raise
        why = " ".join(f"{error}".split())[: MAX_MESSAGE_CHARACTERS // 2] or type(error).__name__
        if isinstance(error, ImportError):
            raise MissingDependency(f"{place} needs another library: {why}") from None
        raise SweepError(f"{place} cannot be used ({why}); check the address and the credentials") from None


@contextmanager
def _explain_damage(path: str | Path) -> Iterator[None]:
    """Turn what Zarr raises about damaged or missing files into a SweepError."""
    try:
        yield
    except SweepError:
        raise
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise SweepError(f"{path} is damaged ({error}); delete it, or give another place") from None
