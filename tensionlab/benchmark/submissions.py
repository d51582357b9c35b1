"""Submissions to the leaderboard: tensions that any program found for the problems of tracks, checked and ranked.

A submission is a folder with `ABOUT_FILE` and, for each track that it solves, a file of that name with tensions
and perhaps times. The tensions are compared with the proved optimum; only the times are taken as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field

from tensionlab.benchmark.optimum import Flags, Optimum, deviations, optimum
from tensionlab.benchmark.problem_files import TRACKS, find_problem_set
from tensionlab.benchmark.problem_sets import problem_of
from tensionlab.benchmark.speed import quantile
from tensionlab.errors import DataError
from tensionlab.solvers.base import Problem
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats, Integers
from tensionlab.support.files.named import list_names
from tensionlab.support.files.reading import as_path, read_toml
from tensionlab.support.files.tables import check_columns, read_npz, read_parquet
from tensionlab.support.formatting import format_duration, format_number, format_share
from tensionlab.support.registry import suggest
from tensionlab.support.table import Column, Table
from tensionlab.support.validation import validate

if TYPE_CHECKING:
    import pandas

ABOUT_FILE = "submission.toml"
KIND = f"a submission: a folder with {ABOUT_FILE} and a file TRACK.npz or TRACK.parquet for each track"
TEMPLATE = Path(__file__).with_name("leaderboard.md")
# A change of tensions is a jump where structure matrix and wrench changed by no more than this share.
JUMP_SHARE = 1e-4
# Means over all tracks: what submissions are ranked by, the first that differs.
MERITS = {
    "optimal_1e6": Column("all", "1e-6 N", format_share),
    "optimal_1e9": Column("all", "1e-9 N", format_share),
    "rendered": Column("rendered", "1e-6 N", format_share),
}
LARGEST = {
    "violation_max": Column("limits", "N", ".2g"),
    "step": Column("step", "N", format_number),
    "jump": Column("jump", "N", format_number),
}
LEFT_OUT = dict.fromkeys(MERITS, 0.0) | dict.fromkeys((*LARGEST, "median_s"), np.nan)  # score on a missing track
Text = Annotated[str, Field(min_length=1), AfterValidator(lambda text: " ".join(text.split()))]


@dataclass(frozen=True)
class About:
    """What `ABOUT_FILE` says of a submission."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    solver: Text
    version: Text
    language: Text
    authors: Annotated[list[Text], Field(min_length=1)]
    machine: Annotated[Text, Field(description="the processor and the system that the times are of")]
    command: Annotated[Text, Field(description="the command that makes the answers again")]


class Track(NamedTuple):
    """Problems of a track with their proved optima."""

    problem: Problem
    best: Optimum
    previous: Integers  # row of the problem before, -1 for none
    moved: Floats  # change from it as a share, (B,); NaN where either is infeasible or there is none


def read_submissions(folder: str | PathLike[str]) -> pandas.DataFrame:
    """Read and score a submission, or every submission in a folder: a row for each and each track.

    The columns are ``submission``, the fields of `About`, ``track`` and the scores: ``rendered``, the share of the
    problems whose wrench and limits are right to 1e-6 N; ``optimal_1e6`` and ``optimal_1e9``, that of those whose
    tensions are the optimum's, too; ``violation_max`` of a limit, in N; ``jump`` and ``step``, the largest change
    of a tension, in N, between nearly equal problems and between others; and ``median_s`` of the times.

    DataError names file, array and entry if one is damaged or does not fit its tracks, or if there is none.
    """
    place = as_path(folder)
    paths = [place] if (place / ABOUT_FILE).exists() else [path.parent for path in place.glob(f"*/{ABOUT_FILE}")]
    if not paths:
        raise DataError(f"{folder}: no {ABOUT_FILE} in it or in a folder of it; give {KIND}")
    return provenance.data_frame([row for path in sorted(paths) for row in _read_submission(path)])


def _read_submission(folder: Path) -> list[dict[str, Any]]:
    about = validate(About, read_toml(folder / ABOUT_FILE, KIND, DataError), DataError, folder / ABOUT_FILE)
    tracks, scores = list_names(TRACKS), {}
    for file in sorted(folder.iterdir()):
        if file.suffix in (".npz", ".parquet"):
            if file.stem not in tracks:
                raise DataError(f"{file}: no track is called {file.stem!r}; {suggest(file.stem, tracks)}")
            if file.stem in scores:
                raise DataError(f"{file}: the track is there twice; keep the NPZ or the Parquet file")
            track = _track(file.stem)
            scores[file.stem] = _score(track, *_read_answers(file, track.problem.lower.shape))
    if not scores:
        raise DataError(f"{folder}: answers to no track; give {KIND}")
    known = {"submission": folder.resolve().name, **vars(about)}
    return [known | {"track": track} | scores.get(track, LEFT_OUT) for track in tracks]


def _read_answers(file: Path, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return the tensions (B, m) and the times (B,) in a file, NaN where there are none."""
    arrays = read_npz(file, KIND, DataError) if file.suffix == ".npz" else _parquet_arrays(file)
    check_columns(list(arrays), ["tensions"], ["times_s"], str(file), DataError)
    arrays = {"times_s": np.full(shape[0], np.nan), **arrays}
    for name, wanted in {"tensions": shape, "times_s": shape[:1]}.items():
        if arrays[name].shape != wanted:
            raise DataError(f"{file}: {name} has shape {arrays[name].shape}; the track has {wanted}")
    tensions, times = arrays["tensions"], arrays["times_s"]
    partial = np.isnan(tensions) & ~np.isnan(tensions).all(axis=1, keepdims=True)
    _refuse(file, "tensions", tensions, np.isinf(tensions) | partial, "newtons, or a row of NaN for no answer")
    _refuse(file, "times_s", times, np.isinf(times) | (times <= 0.0), "seconds above 0, or NaN where not measured")
    return tensions, times


def _parquet_arrays(file: Path) -> dict[str, Floats]:
    columns = read_parquet(file, KIND, DataError).columns.to_pydict()
    try:
        return {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    except (TypeError, ValueError):
        raise DataError(f"{file}: give numbers in times_s, and in tensions lists of one length") from None


def _refuse(file: Path, name: str, values: Floats, wrong: Flags, wanted: str) -> None:
    """Refuse the first entry that is wrong, by its index."""
    for index in np.argwhere(wrong)[:1].tolist():
        raise DataError(f"{file}: {name}{index} is {values[tuple(index)]:g}; give {wanted}")


@cache
def _track(name: str) -> Track:
    """Return the problems of a track under the policy "force", with their proved optima."""
    (group,) = find_problem_set(name, 1).groups
    problem, previous = problem_of(group, "force"), np.asarray(group.previous)
    best = optimum(problem)
    both = (problem.structure.reshape(len(problem), -1), problem.wrench)
    changes = [np.linalg.norm(rows - rows[previous], axis=1) / np.linalg.norm(rows, axis=1) for rows in both]
    known = (previous >= 0) & best.reachable & best.reachable[previous]
    return Track(problem, best, previous, np.where(known, np.maximum(*changes), np.nan))


def _score(track: Track, tensions: Floats, times_s: Floats) -> dict[str, float]:
    """Compare tensions with the optima of a track."""
    deviation = deviations(track.problem, track.best, tensions)
    scale = np.maximum(1.0, np.linalg.norm(track.problem.wrench, axis=1))
    off = np.maximum(deviation["error"], deviation["violation"]) / scale
    off_optimum = np.maximum(off, deviation["gap"] / scale)
    change = np.abs(tensions - tensions[track.previous]).max(axis=1)
    return {
        "rendered": float((off <= 1e-6).mean()),
        "optimal_1e6": float((off_optimum <= 1e-6).mean()),
        "optimal_1e9": float((off_optimum <= 1e-9).mean()),
        "violation_max": quantile(deviation["violation"], 1.0),
        "jump": quantile(change[track.moved <= JUMP_SHARE], 1.0),
        "step": quantile(change[track.moved > JUMP_SHARE], 1.0),
        "median_s": quantile(times_s, 0.5),
    }


def leaderboard(rows: pandas.DataFrame) -> Table:
    """Return a row for each submission of `read_submissions`, the best first."""
    solved = rows.pivot(index="submission", columns="track", values="optimal_1e6")
    groups = rows.groupby("submission")
    parts = [solved, groups[[*MERITS]].mean().round(9), groups[[*LARGEST]].max()]
    table = groups[["language"]].first().join(parts).sort_values([*MERITS], ascending=False, kind="stable")
    merits = table[[*MERITS]]
    better = (merits != merits.shift()).any(axis=1)
    rank = np.maximum.accumulate(np.where(better, np.arange(1, len(table) + 1), 1))
    shares = (Column(track, format=format_share) for track in solved)
    columns = ["rank", "submission", "language", *shares, *MERITS.values(), *LARGEST.values()]
    ranked = ([place, *row] for place, row in zip(rank, table.itertuples(), strict=True))
    return Table(columns, ranked, "Leaderboard")


def times(rows: pandas.DataFrame) -> list[Table]:
    """Return the median times of submissions that have some: a table for each machine, the fastest first."""
    medians = rows.pivot(index=["machine", "submission"], columns="track", values="median_s").dropna(how="all")
    medians["mean"] = medians.mean(axis=1, skipna=False)
    columns = ["submission", *(Column(name, format=format_duration) for name in medians)]
    return [
        Table(columns, ([name, *values] for (_, name), *values in own.itertuples()), f"Times on {machine}")
        for machine, own in medians.sort_values("mean").groupby("machine")
    ]


def to_markdown(rows: pandas.DataFrame) -> str:
    """Return the leaderboard as a page in Markdown."""
    sources = [
        f"- **{own.submission}**: {own.solver} {own.version}, by {', '.join(own.authors)}: `{own.command}`"
        for own in rows.drop_duplicates("submission").itertuples()
    ]
    by_machine = (f"### {table.title}\n\n{table.to_markdown()}" for table in times(rows))
    ranks, text = leaderboard(rows).to_markdown(), TEMPLATE.read_text(encoding="utf-8")
    return text.format(ranks=ranks, times="\n\n".join(by_machine), sources="\n".join(sources))
