"""Data sets that come with this package, by name: `names` and `load`.

A name is the path of a file in ``datasets/`` without its suffix, such as ``vectors/grid18``; each folder has one
kind of data, and its ``README.md`` is their card: origin, columns, units, licence, how to regenerate. The problem
sets, under ``problems/``, are generated. Where only one kind will do, the name is without its folder:
``tl.load_rig("ipanema-2")``, ``tensionlab compare ipanema-2``.

`folder` is where the files are: in a clone its ``datasets/``, in an installed package a copy of that.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from tensionlab.errors import DataError, InputError
from tensionlab.support.files.named import SUFFIXES, list_names
from tensionlab.support.files.reading import brief
from tensionlab.support.files.reading import datasets_folder as folder
from tensionlab.support.registry import suggest

__all__ = ["folder", "load", "names"]
PROBLEMS = "problems"
KINDS = (*SUFFIXES, PROBLEMS)
PROBLEM_COUNT = 1000  # problems that a problem set has


def names(kind: str | None = None, folder: str | Path | None = None) -> list[str]:
    """List the names of all data sets, as `load` takes them, or those of one kind, such as "recordings".

    InputError if there is no such folder or kind.

    Parameters
    ----------
    kind : str, optional
        One of "rigs", "spaces", "vectors", "published", "recordings", "what-if", "benchmarks", "tracks",
        "problems".
    folder : path, optional
        Where the data sets are; left out: those that come with this package.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.datasets.names("vectors")
    ['vectors/grid18']
    """
    from tensionlab.benchmark.problem_sets import PROBLEM_SETS

    where = _found(folder)
    if kind is not None and kind not in KINDS:
        raise InputError(f"no data sets are called {kind!r}; {suggest(kind, KINDS)}")
    stored = [f"{folder_name}/{name}" for folder_name in SUFFIXES for name in list_names(folder_name, where)]
    every = [*stored, *(f"{PROBLEMS}/{name}" for name in PROBLEM_SETS)]
    return [name for name in every if kind is None or name.startswith(f"{kind}/")]


def load(name: str, folder: str | Path | None = None) -> Any:
    """Read a data set, one of `names`, from this package or from another folder.

    InputError, DataError or RigError if there is no data set of that name, or its file is damaged.

    Parameters
    ----------
    name : str
        One of `names`.
    folder : path, optional
        Where the data sets are; left out: those that come with this package.

    Returns
    -------
    object
        By folder: ``rigs`` a `tensionlab.Rig`; ``spaces`` a `LayoutTask`; ``vectors`` a (K, 3) array;
        ``published`` and ``what-if`` a DataFrame; ``recordings`` a `Recording`; ``benchmarks`` the `Results`;
        ``tracks`` a `ProblemSet`; ``problems`` one of 1000 problems, drawn with seed 0.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.datasets.load("vectors/grid18").shape
    (182, 3)
    >>> tl.datasets.load("rigs/seven-modules").m
    7
    """
    if not isinstance(name, str):
        raise InputError(f"the name of a data set is text, such as 'vectors/grid18'; got {name!r}")
    known = names(folder=folder)
    if name not in known:
        advice = suggest(name, known, "`tensionlab.datasets.names()` lists them")
        raise InputError(f"no data set is called {brief(name)}; {advice}")
    kind, _, stem = name.partition("/")
    if kind == PROBLEMS:
        from tensionlab.benchmark.problem_sets import problem_set

        return problem_set(stem, PROBLEM_COUNT)
    module, function = READERS[kind]
    return getattr(import_module(module), function)(_found(folder) / kind / f"{stem}{SUFFIXES[kind]}")


def _found(named: str | Path | None) -> Path:
    """Return the folder that was named, or else this package's."""
    if named is None:
        return folder()
    if not Path(named).is_dir():
        raise InputError(f"{named}: no such folder; leave it out for the data sets that come with tensionlab")
    return Path(named)


def _read_frame(path: Path) -> Any:
    """Return a Parquet file with pandas."""
    from tensionlab.support.files.tables import read_parquet
    from tensionlab.support.provenance import data_frame

    return data_frame(read_parquet(path, "a table (*.parquet)", DataError).columns.to_pydict())


READERS = {
    "rigs": ("tensionlab.model.files", "load_rig"),
    "spaces": ("tensionlab.workspace.layout.task", "load_task"),
    "vectors": ("tensionlab.validation.data_tables", "read_vectors"),
    "published": ("tensionlab.validation.data_tables", "read_published"),
    "recordings": ("tensionlab.validation.data_tables", "read_recording"),
    "what-if": (__name__, "_read_frame"),
    "benchmarks": ("tensionlab.benchmark.results", "read"),
    "tracks": ("tensionlab.benchmark.problem_files", "read_track"),
}  # module and function that read a file of each kind


def __dir__() -> list[str]:
    return sorted(__all__)
