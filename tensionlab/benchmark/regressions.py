"""Regressions from one benchmark to another: what became slower or less accurate on the same problems.

Times: of each problem new over old, the best call of each; their median, with a 99 % interval from the order of
the ratios, which assumes no distribution. The machine's drift is divided out: the median ratio of the baselines,
whose code is not tensionlab's; with fewer than two it counts as none. A change is beyond noise where the whole
interval is beyond 10 %, and beyond what the baselines differ by among themselves. Where the machine was busy in
either run, times are not judged.

Accuracy: solvers give the same answers to the same problems but for rounding, so that one problem is enough. It is
lost where it was solved to 1e-3, 1e-6 or 1e-9 N and now has more than ten times that error, or no answer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.benchmark.report import IDLE_SHARE
from tensionlab.benchmark.results import ACCURACIES, ID, KEY, Results
from tensionlab.errors import InputError
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_count
from tensionlab.support.provenance import data_frame
from tensionlab.support.table import Column, Table

if TYPE_CHECKING:
    import pandas

NOISE = 0.10  # changes of a time that are never beyond noise, as a share
EDGE = 10.0  # how many times an accuracy an error must be for the problem to be lost: less is rounding
QUANTILE = 2.576  # quantile of the normal distribution for an interval of 99 %
MIN_PROBLEMS = 8  # timed in both runs: fewer have no interval of 99 %


@dataclass(frozen=True, eq=False)
class Regressions:
    """Changes of all entries that both benchmarks have, and both manifests.

    Attributes
    ----------
    changes : DataFrame
        A row for each problem set, solver and policy, in the order of the new benchmark. ``ratio`` is the median
        of new over old times, without the machine's drift, ``ratio_low`` and ``ratio_high`` its 99 % interval; NaN
        where fewer than `MIN_PROBLEMS` were timed in both. ``noise`` is what it must exceed. Problems ``lost``
        were solved before and are not now; ``gained`` the other way round. ``verdict`` says what changed beyond
        noise, in words; ``regressed`` tells whether it is slower or less accurate.
    drift : dict
        Ratio of the baselines by problem set; NaN where there are fewer than two.
    judged : bool
        Whether times are: the machine was idle enough in both runs.
    """

    changes: pandas.DataFrame
    drift: dict[str, float]
    judged: bool
    old: dict[str, Any]
    new: dict[str, Any]

    @property
    def worse(self) -> pandas.DataFrame:
        """The changes for the worse."""
        return self.changes[self.changes["regressed"]]

    @property
    def title(self) -> str:
        """How many entries, and how many of them became slower or less accurate."""
        slower = self.changes["verdict"].str.contains("slower").sum()
        times = f"{slower} slower" if self.judged else "times not judged, the machine was busy"
        lost = (self.changes["lost"] > 0).sum()
        return f"{format_count(len(self.changes), 'row')}: {lost} less accurate, {times}"

    def __repr__(self) -> str:
        return f"<Regressions of {self.title}>"

    def _repr_html_(self) -> str:
        return self.table(self.changes)._repr_html_()

    def table(self, changes: pandas.DataFrame) -> Table:
        """Return a row for each of these changes."""
        columns = ["set", "solver", "policy", Column("time", "new / old", ".2f"), Column("99 % interval"),
                   "problems lost", "gained", "beyond noise"]  # fmt: skip
        rows = [
            [
                row.problem_set,
                row.solver,
                row.policy or None,
                row.ratio,
                None if np.isnan(row.ratio) else f"{row.ratio_low:.2f} to {row.ratio_high:.2f}",
                row.lost or None,
                row.gained or None,
                row.verdict,
            ]
            for row in changes.itertuples()
        ]
        return Table(columns, rows, self.title)

    def report(self) -> str:
        """Return the report in Markdown."""
        drift = ", ".join(f"{name} {ratio:.2g}" for name, ratio in self.drift.items())
        differ = "; **the processors differ**" * (self.old["processor"] != self.new["processor"])
        parts = [
            "# Regressions of a benchmark",
            f"{self.title}.",
            f"- Old: {_run(self.old)}\n- New: {_run(self.new)}{differ}\n"
            f"- Times of the baselines, new over old: {drift or 'none'}",
            "## Slower or less accurate",
            self.table(self.worse).to_markdown() if len(self.worse) else "None.",
            "## All entries",
            self.table(self.changes).to_markdown(),
            "## How to read it",
            (__doc__ or "").partition("\n\n")[2].strip(),
        ]
        return "\n\n".join(parts) + "\n"


def find_regressions(old: Results, new: Results) -> Regressions:
    """Compare two benchmarks of the same problems.

    Parameters
    ----------
    old, new : Results
        With measurements of each problem: of a run, not the committed ones.

    Raises
    ------
    InputError
        If they have no set and entry in common, measured other problems, or have no measurements.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.benchmark.regressions import find_regressions
    >>> old, new = (tl.benchmark.run(["newton", "dykstra"], ["edge"], count=12, quick=True) for _ in range(2))
    >>> find_regressions(old, new).changes[["solver", "lost"]].values.tolist()
    [['newton', 0], ['dykstra', 0]]
    """
    tables = (each.each_problem() for each in (new, old))
    one, other = (
        table[table.groupby(KEY)["tried"].transform("any")] for table in tables
    )  # entries that took part
    both = one.merge(other, on=[*ID, "label"], suffixes=("", "_old"))
    if both.empty:
        raise InputError("the two benchmarks have no entry on a problem set in common; nothing can be compared")
    judged = all(each.manifest["bench"]["processor_share"] >= IDLE_SHARE for each in (old, new))
    both["log_ratio"] = np.log(both["call_s"] / both["call_s_old"])
    changes, drift = [], {}
    for problem_set, rows in both.groupby("problem_set", sort=False):
        name = str(problem_set)
        _require_same_problems(name, old, new)
        baselines = rows[rows["setting"] != "proved"].groupby(KEY)["log_ratio"].median().dropna()
        enough = len(baselines) > 1
        centre, spread = (baselines.median(), np.ptp(baselines)) if enough else (0.0, 0.0)
        noise = max(NOISE, float(np.expm1(spread))) if judged else np.inf
        drift[name] = float(np.exp(centre)) if enough else np.nan
        changes += [_change(own, centre, noise) for _, own in rows.groupby(KEY, sort=False)]
    return Regressions(data_frame(changes), drift, judged, old.manifest, new.manifest)


def _require_same_problems(name: str, old: Results, new: Results) -> None:
    if old.sets[name].get("checksum") != new.sets[name].get("checksum"):
        counts = [f"seed {each.manifest['seed']}, {each.sets[name]['problems']} problems" for each in (old, new)]
        raise InputError(
            f"set {name}: other problems (old: {counts[0]}; new: {counts[1]}); measure again with the same count "
            "and seed, by the same version of tensionlab's problem sets"
        )


def _change(rows: pandas.DataFrame, drift: float, noise: float) -> dict[str, Any]:
    """Return the row of `Regressions.changes` of one entry, from its problems in both benchmarks."""
    ratios = np.sort(rows["log_ratio"].dropna()) - drift
    count = len(ratios)
    median = low = high = np.nan
    if count >= MIN_PROBLEMS:
        rank = max(0, int(count / 2 - QUANTILE * np.sqrt(count) / 2))
        median, low, high = map(float, np.exp([np.median(ratios), ratios[rank], ratios[count - 1 - rank]]))
    old, new = (
        np.maximum(rows[f"error{end}"], rows[f"violation{end}"]).to_numpy() / rows[f"scale{end}"].to_numpy()
        for end in ("_old", "")
    )
    lost = _solved_only_in(old, new, rows["tried"].to_numpy() > 0)
    gained = _solved_only_in(new, old, rows["tried_old"].to_numpy() > 0)
    verdicts = {
        "slower": low > 1.0 + noise,
        "less accurate": lost > 0,
        "faster": high < 1.0 / (1.0 + noise),
        "more accurate": gained > lost == 0,
    }
    first = rows.iloc[0]
    return {
        "problem_set": first["problem_set"],
        "solver": first["label"],
        "policy": first["policy"],
        "ratio": median,
        "ratio_low": low,
        "ratio_high": high,
        "noise": noise,
        "lost": lost,
        "gained": gained,
        "verdict": ", ".join(word for word, true in verdicts.items() if true),
        "regressed": bool(verdicts["slower"] or lost),
    }


def _solved_only_in(one: Floats, other: Floats, tried: Any) -> int:
    """Return how many problems of one run's errors are solved to an accuracy that the other missed by far."""
    unanswered = np.isnan(other) & tried
    missed = [(one <= accuracy) & (unanswered | (other > EDGE * accuracy)) for accuracy in ACCURACIES]
    return int(np.any(missed, axis=0).sum())


def _run(manifest: Mapping[str, Any]) -> str:
    commit = manifest["git_commit"] or "no commit"
    return f"{manifest['date']}, {commit:.12}, {manifest['processor']}; `{manifest['call']}`"
