"""Problem sets on disk: quadratic programs as qpbenchmark keeps them, in a Parquet file or a folder of NPZ files.

A program is ``minimise x'Px/2 + q'x subject to Gx <= h, Ax = b, lb <= x <= ub``. It is a problem of tension
allocation if P is diagonal and positive, there is no G, and all bounds are finite: with ``t = D x + q/D``, D the
square root of P, it asks for the least ``|t|²`` inside limits that renders ``W t = w``, ``W = A/D``,
``w = b + A (q/P)``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from tensionlab.benchmark.optimum import optimum
from tensionlab.benchmark.problem_sets import PROBLEM_SETS, Group, ProblemSet, problem_of, problem_set, size_label
from tensionlab.errors import DataError, InputError, ShapeError
from tensionlab.support.arrays import Floats, check_size
from tensionlab.support.files.named import list_names
from tensionlab.support.files.reading import as_path, datasets_folder
from tensionlab.support.files.tables import check_columns, read_npz, read_parquet

KIND = "quadratic programs: a Parquet file, or a folder of NPZ files"
# Arrays of a program, as in qpsolvers and qpbenchmark; P left out is the identity, and q zero.
KEYS = ("P", "q", "G", "h", "A", "b", "lb", "ub")
TRACKS = "tracks"  # folder of the data sets
TRACK_KEYS = ("structure", "wrench", "lower", "upper", "previous")  # fields of a `Group`


def find_problem_set(name: str, count: int, seed: int = 0) -> ProblemSet:
    """Return the problems of a set, by its name in `PROBLEM_SETS` or its path, as `read_problem_set` reads it.

    Of a path, an even selection of about as many as the count; the seed has no meaning there. A track, by its name
    in ``datasets/tracks``, is always whole.
    """
    if name in PROBLEM_SETS:
        return problem_set(name, count, seed)
    if name in list_names(TRACKS):
        return read_track(datasets_folder() / TRACKS / f"{name}.npz")
    if not Path(name).exists():
        choice = f"choose one of {', '.join(PROBLEM_SETS)}, or give {KIND}"
        raise InputError(f"no problem set is called {name!r}; {choice}")
    return read_problem_set(name, count)


def read_problem_set(path: str | PathLike[str], count: int | None = None) -> ProblemSet:
    """Read tension allocation problems from quadratic programs.

    They are in a Parquet file as of qpbenchmark's ``ParquetTestSet``, with a row for each program, or in a folder
    of NPZ files as of qpsolvers' ``Problem.save``, in it or in its folder ``data``, as in qpbenchmark's
    repositories. Programs that are no tension allocation problems are left out, and counted in the title.

    Parameters
    ----------
    path : path
        A Parquet file with the columns A, b, lb and ub, and perhaps P, q, G, h, name and group, matrices row by
        row in one list; or a folder.
    count : int, optional
        Read an even selection of about this many; all if left out. DataError if there are no programs, none is a
        problem of tension allocation, or one is damaged; says which and why.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.benchmark.problem_files import read_problem_set
    >>> tug_of_war = {"A": np.array([[1.0, -1.0]]), "b": np.array([2.0])}
    >>> np.savez("tug.npz", P=2 * np.eye(2), q=np.zeros(2), lb=np.ones(2), ub=np.full(2, 5.0), **tug_of_war)
    >>> read_problem_set(".")
    <ProblemSet .: 1 problems in 1 groups, 1 of 1 quadratic programs>
    """
    source = as_path(path)
    programs: list[Program]
    if source.is_dir():
        files = sorted(source.glob("*.npz")) or sorted(source.glob("data/*.npz"))
        programs = [(str(file), read_npz(file, KIND, DataError, absent=KEYS), None) for file in files]
    else:
        programs = list(_in_parquet(source))
    by_group: dict[str, list[tuple[Floats, ...]]] = {}
    left_out: Counter[str] = Counter()
    for where, arrays, group in programs:
        problem = _allocation(where, arrays)
        if isinstance(problem, str):
            left_out[problem] += 1
        else:
            by_group.setdefault(group or size_label(*problem[0].shape), []).append(problem)
    reasons = ", ".join(f"{number} with {reason}" for reason, number in left_out.most_common())
    if not by_group:
        what = f"none of its {len(programs)} programs is a problem of tension allocation: {reasons}"
        raise DataError(f"{path}: {what if programs else 'no programs'}; give {KIND}")
    kept = len(programs) - left_out.total()
    share = 1.0 if count is None else min(1.0, count / kept)
    groups = []
    for label, rows in by_group.items():
        chosen = [rows[i] for i in np.linspace(0, len(rows) - 1, max(1, round(share * len(rows)))).astype(int)]
        if len({structure.shape for structure, *_ in chosen}) > 1:
            raise DataError(f"{path}: {label}: its programs differ in size; give each size a group of its own")
        groups.append(Group(label, *(np.array(column) for column in zip(*chosen, strict=True))))
    title = f"{kept} of {len(programs)} quadratic programs" + (f"; left out: {reasons}" if reasons else "")
    return _stored_set(str(path), title, *groups)


def read_track(path: str | PathLike[str]) -> ProblemSet:
    """Read the problems of a track of the leaderboard, one group, from an NPZ file of ``datasets/tracks``."""
    name, arrays = as_path(path).stem, read_npz(path, "a track (*.npz)", DataError)
    check_columns(list(arrays), TRACK_KEYS, (), str(path), DataError)
    structure, wrench, lower, upper, previous = (arrays[key] for key in TRACK_KEYS)
    group = Group(size_label(*structure.shape[1:]), structure, wrench, lower, upper, previous.astype(int))
    start = "each from scratch" if (previous < 0).all() else "started from the problem before"
    return _stored_set(name, f"problems of the leaderboard, {start}", group)


def _stored_set(name: str, title: str, *groups: Group) -> ProblemSet:
    """Return problems from files; the exact solver finds out whether they are feasible."""
    feasible = np.concatenate([optimum(problem_of(group, "force")).reachable for group in groups])
    return ProblemSet(name, title, groups, "all" if feasible.all() else "mixed" if feasible.any() else "none")


Program = tuple[str, Mapping[str, Floats], str | None]  # where it was, its arrays by `KEYS`, and its group


def _in_parquet(path: Path) -> Iterator[Program]:
    """Yield the programs in the rows of a Parquet file."""
    if path.suffix == ".npz":
        raise DataError(f"{path}: one program; give the folder that it is in")
    for number, row in enumerate(read_parquet(path, KIND, DataError).columns.to_pylist(), start=1):
        where, arrays = f"{path}: row {number}", {}
        for key in KEYS:
            try:
                if row.get(key) is not None:
                    arrays[key] = np.array(row[key], dtype=np.float64)
            except (TypeError, ValueError):
                advice = "give a matrix row by row in one list"
                raise DataError(f"{where}: {key} is no list of numbers; {advice}") from None
        label = row.get("group")
        yield where, arrays, None if label is None else str(label)


def _allocation(where: str, arrays: Mapping[str, Floats]) -> tuple[Floats, Floats, Floats, Floats] | str:
    """Return structure, wrench and limits of a program, or why it is not a problem of tension allocation."""
    if "lb" not in arrays or "ub" not in arrays:
        return "an unbounded variable"
    if "A" not in arrays or "b" not in arrays:
        return "no equations"
    lower, upper, wrench = (arrays[key].ravel() for key in ("lb", "ub", "b"))
    n, m = wrench.size, lower.size
    arrays = {"P": np.eye(m), "q": np.zeros(m), **arrays}
    for name, size in {"ub": m, "q": m, "P": m * m, "A": n * m}.items():
        if arrays[name].size != size:
            fits = f"with {m} in lb and {n} in b it must have {size}"
            raise DataError(f"{where}: {name} has {arrays[name].size} entries; {fits}")
    weights = arrays["P"].reshape(m, m)
    diagonal, linear = np.diag(weights), arrays["q"].ravel()
    if "G" in arrays:
        return "inequalities"
    if not np.array_equal(weights, np.diag(diagonal)):
        return "P not diagonal"
    if not (diagonal > 0.0).all():
        return "P not positive"
    if not np.isfinite([lower, upper]).all():
        return "an unbounded variable"
    try:
        check_size(n, m)
    except ShapeError:
        return "too many variables or equations"
    root, equations = np.sqrt(diagonal), arrays["A"].reshape(n, m)
    offset, rendered = linear / root, wrench + equations @ (linear / diagonal)
    problem = equations / root, rendered, root * lower + offset, root * upper + offset
    if not all(np.isfinite(array).all() for array in problem) or (lower > upper).any():
        raise DataError(f"{where}: A, b and q must be finite, and lb nowhere above ub")
    return problem


def qp_rows(problems: ProblemSet) -> list[dict[str, Any]]:
    """Return the problems of a set as rows of quadratic programs of the tensions, for benchmarks of QP solvers.

    In the columns that qpbenchmark's `ParquetTestSet` reads: matrices row by row in one list, G and h None because
    there are no other inequalities. The name is of set, group and row.
    """
    return [
        {"name": f"{problems.name}/{group.label}/{row}"}
        | {"P": np.eye(len(lower)).ravel(), "q": np.zeros(len(lower))}
        | {"G": None, "h": None, "A": structure.ravel(), "b": wrench}
        | {"lb": lower, "ub": upper, "group": group.label}
        for group in problems.groups
        for row, (structure, wrench, lower, upper) in enumerate(zip(*problem_of(group).arrays[:4], strict=True))
    ]
