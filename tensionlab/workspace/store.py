"""Where the values of a sweep go: into memory, or into a Zarr store that a killed sweep goes on with.

Beside its arrays an unfinished store has a ledger: a line with the number of every finished chunk, written once
the data of the chunk are on disk. A line that a kill cut short does not count. A finished store has no ledger, and
is nothing but Zarr. Its format is version 2, in which texts have a specification.
"""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tensionlab.errors import MissingDependency, SweepError
from tensionlab.model.kinematics import Floats
from tensionlab.workspace import labels
from tensionlab.workspace.plan import Plan, Task

if TYPE_CHECKING:
    import xarray

LARGEST = 2_000_000_000
"""Bytes of the largest sweep that is kept in memory."""

LEDGER = ".finished"


class Sink(Protocol):
    """Where values go; ``finished`` holds the numbers of the chunks that it has already."""

    finished: Container[int]

    def write(self, task: Task, values: Floats) -> None:
        """Keep the values of one chunk, (measures, *shape of its block)."""

    def dataset(self) -> xarray.Dataset:
        """Give the whole back, once every chunk is written."""


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


class Store:
    """Writes a sweep to a Zarr store, or goes on with one.

    Raises
    ------
    MissingDependency
        If zarr is not installed.
    SweepError
        If there is something else at the path, or the store of another sweep; it says what differs.
    """

    def __init__(self, path: Path, plan: Plan, bare: xarray.Dataset) -> None:
        try:
            import zarr
        except ImportError as error:
            raise MissingDependency('a store needs zarr: pip install "tensionlab[workspace]"') from error
        self._path, self._ledger = path, path / LEDGER
        if path.exists():
            _check(path, bare.attrs["sweep"])
        else:
            _create(path, plan, bare)
        group = zarr.open_group(path, mode="r+")
        self._arrays = [group[name] for name in plan.measures]
        self._chunks = plan.chunks
        self.finished: Container[int] = range(math.prod(plan.tiles))
        if self._ledger.exists():
            whole = self._ledger.read_bytes().rpartition(b"\n")
            os.truncate(self._ledger, len(whole[0]) + len(whole[1]))
            self.finished = {int(line) for line in whole[0].split()}

    def write(self, task: Task, values: Floats) -> None:
        """Write the values of one chunk, and then that it is finished."""
        tile = tuple(part.start // size for part, size in zip(task.block, self._chunks, strict=True))
        for array, part in zip(self._arrays, values, strict=True):
            array[task.block] = part
            file = self._path / array.basename / array.metadata.encode_chunk_key(tile)
            if file.exists():  # Zarr leaves out chunks that are NaN all over
                with file.open("rb+") as written:
                    os.fsync(written.fileno())
        with self._ledger.open("ab") as ledger:
            ledger.write(b"%d\n" % task.number)
            ledger.flush()
            os.fsync(ledger.fileno())

    def dataset(self) -> xarray.Dataset:
        """Strike the ledger, and open the whole; values are read when they are asked for."""
        import xarray

        self._ledger.unlink(missing_ok=True)
        data: xarray.Dataset = xarray.open_zarr(self._path, chunks=None)
        return data


def _check(path: Path, wanted: str) -> None:
    """Refuse what is no store of this very sweep."""
    import zarr

    try:
        found = json.loads(zarr.open_group(path, mode="r").attrs["sweep"])
    except (OSError, ValueError, KeyError, TypeError):
        raise SweepError(f"{path} is there and holds no sweep; give another place to write to") from None
    differs = [part for part, value in json.loads(wanted).items() if found.get(part) != value]
    if differs:
        raise SweepError(
            f"{path} holds a sweep that differs in {' and '.join(differs)}; give another place, or delete it"
        )


def _create(path: Path, plan: Plan, bare: xarray.Dataset) -> None:
    """Make a store without values, under another name until it is complete."""
    import zarr

    if not path.absolute().parent.is_dir():
        raise SweepError(f"no folder {path.absolute().parent}; make it first")
    new = path.with_name(f".{path.name}.new")
    shutil.rmtree(new, ignore_errors=True)
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
    (new / LEDGER).touch()
    new.rename(path)
