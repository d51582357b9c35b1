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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.benchmark import report
from tensionlab.benchmark.results import ACCURACIES, EntryResult, Results
from tensionlab.errors import InputError
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_count
from tensionlab.support.table import Column, Table

if TYPE_CHECKING:
    import pandas

NOISE = 0.10  # changes of a time that are never beyond noise, as a share
EDGE = 10.0  # an error must pass an accuracy by so much that it is no matter of rounding
QUANTILE = 2.576  # quantile of the normal distribution for an interval of 99 %
MIN_PROBLEMS = 8  # timed in both runs: fewer have no interval of 99 %


@dataclass(frozen=True)
class EntryChange:
    """How one entry changed on one problem set.

    ``ratio`` is the median of new over old times, without the machine's drift, with its 99 % interval; NaN where
    fewer than `MIN_PROBLEMS` were timed in both runs. ``noise`` is what it must exceed. Problems ``lost`` were
    solved before and are not now; ``gained`` the other way round.
    """

    problem_set: str
    solver: str
    policy: str | None
    ratio: float
    ratio_low: float
    ratio_high: float
    noise: float
    lost: int
    gained: int

    @property
    def slower(self) -> bool:
        """Whether it is slower beyond noise."""
        return self.ratio_low > 1.0 + self.noise

    @property
    def faster(self) -> bool:
        """Whether it is faster beyond noise."""
        return self.ratio_high < 1.0 / (1.0 + self.noise)

    @property
    def verdict(self) -> str:
        """What changed beyond noise, in words."""
        words = {"slower": self.slower, "less accurate": self.lost > 0, "faster": self.faster,
                 "more accurate": self.gained > self.lost == 0}  # fmt: skip
        return ", ".join(word for word, true in words.items() if true)

    @property
    def regressed(self) -> bool:
        """Whether it is slower or less accurate."""
        return self.slower or self.lost > 0


@dataclass(frozen=True)
class Regressions:
    """Changes of all entries that both benchmarks have, in the order of the new one; and both manifests.

    ``drift`` is the ratio of the baselines by problem set; NaN where there are fewer than two. ``judged`` tells
    whether times are: the machine was idle enough in both runs.
    """

    changes: tuple[EntryChange, ...]
    drift: dict[str, float]
    judged: bool
    old: dict[str, Any]
    new: dict[str, Any]

    @property
    def found(self) -> list[EntryChange]:
        """The changes for the worse."""
        return [each for each in self.changes if each.regressed]

    @property
    def title(self) -> str:
        """How many entries, and how many of them became slower or less accurate."""
        slower, lost = sum(each.slower for each in self.changes), sum(each.lost > 0 for each in self.changes)
        times = f"{slower} slower" if self.judged else "times not judged, the machine was busy"
        return f"{format_count(len(self.changes), 'row')}: {lost} less accurate, {times}"

    def __repr__(self) -> str:
        return f"<Regressions of {self.title}>"

    def _repr_html_(self) -> str:
        return self.table(self.changes)._repr_html_()

    def table(self, changes: Sequence[EntryChange]) -> Table:
        """Return a row for each of these changes."""
        columns = ["set", "solver", "policy", Column("time", "new / old", ".2f"), Column("99 % interval"),
                   "problems lost", "gained", "beyond noise"]  # fmt: skip
        rows = [
            [
                each.problem_set,
                each.solver,
                each.policy,
                each.ratio,
                None if np.isnan(each.ratio) else f"{each.ratio_low:.2f} to {each.ratio_high:.2f}",
                each.lost or None,
                each.gained or None,
                each.verdict,
            ]
            for each in changes
        ]
        return Table(columns, rows, self.title)

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for each change, as in `EntryChange`; MissingDependency if pandas is not installed."""
        return provenance.data_frame([vars(each) | {"verdict": each.verdict} for each in self.changes])

    def report(self) -> str:
        """Return the report in Markdown."""
        worse = self.found
        drift = ", ".join(f"{name} {report.times(ratio)}" for name, ratio in self.drift.items())
        differ = "; **the processors differ**" * (self.old["processor"] != self.new["processor"])
        parts = [
            "# Regressions of a benchmark",
            f"{self.title}.",
            f"- Old: {_run(self.old)}\n- New: {_run(self.new)}{differ}\n"
            f"- Times of the baselines, new over old: {drift}",
            "## Slower or less accurate",
            self.table(worse).to_markdown() if worse else "None.",
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
        With evidence for single problems: runs' own, as `tensionlab.benchmark.results.read` reads them, not
        those that are committed.

    Returns
    -------
    Regressions

    Raises
    ------
    InputError
        If they have no set and entry in common, measured other problems, or have no evidence.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab.benchmark.regressions import find_regressions
    >>> old, new = (tl.benchmark.run(["newton", "dykstra"], ["edge"], count=12, quick=True) for _ in range(2))
    >>> [(each.solver, each.lost) for each in find_regressions(old, new).changes]
    [('newton', 0), ('dykstra', 0)]
    """
    before = _by_key(old)
    judged = all(each.manifest["bench"]["processor_share"] >= report.IDLE_SHARE for each in (old, new))
    changes: list[EntryChange] = []
    drift: dict[str, float] = {}
    for name in new.sets:
        pairs = [(before[key], row) for key, row in _by_key(new).items() if key[0] == name and key in before]
        if not pairs:
            continue
        _require_same(name, old, new)
        controls = _controls(pairs)
        centre, spread = (float(np.median(controls)), float(np.ptp(controls))) if len(controls) > 1 else (0.0, 0.0)
        noise = max(NOISE, float(np.expm1(spread))) if judged else np.inf
        drift[name] = float(np.exp(centre)) if len(controls) > 1 else np.nan
        changes += [_change(one, other, centre, noise) for one, other in pairs]
    if not changes:
        raise InputError("the two benchmarks have no entry on a problem set in common; nothing can be compared")
    return Regressions(tuple(changes), drift, judged, old.manifest, new.manifest)


def _by_key(results: Results) -> dict[tuple[str, str, str | None], EntryResult]:
    """Return the rows that took part."""
    return {(row.problem_set, row.label, row.policy): row for row in results.rows if row.tried}


def _require_same(name: str, old: Results, new: Results) -> None:
    """Refuse results of other problems, or without evidence."""
    for results, which in ((old, "old"), (new, "new")):
        if any(not row.scales for row in results.of_set(name) if row.tried):
            raise InputError(f"the {which} results have no evidence for single problems; give the folder of a run")
    if old.sets[name].get("checksum") != new.sets[name].get("checksum"):
        counts = [f"seed {each.manifest['seed']}, {each.sets[name]['problems']} problems" for each in (old, new)]
        raise InputError(
            f"set {name}: other problems (old: {counts[0]}; new: {counts[1]}); measure again with the same count "
            "and seed, by the same version of tensionlab's problem sets"
        )


def _log_ratios(old: EntryResult, new: EntryResult) -> Floats:
    """Return the logarithm of new over old times of the problems that both timed."""
    with np.errstate(invalid="ignore"):
        ratios = np.log(np.array(new.call_s)) - np.log(np.array(old.call_s))
    return np.asarray(ratios[np.isfinite(ratios)])


def _controls(pairs: Sequence[tuple[EntryResult, EntryResult]]) -> Floats:
    """Return the median logarithmic ratio of each baseline."""
    ratios = [_log_ratios(old, new) for old, new in pairs if new.setting != "proved"]
    return np.array([np.median(each) for each in ratios if each.size])


def _change(old: EntryResult, new: EntryResult, drift: float, noise: float) -> EntryChange:
    ratios = np.sort(_log_ratios(old, new)) - drift
    count = len(ratios)
    median = low = high = np.nan
    if count >= MIN_PROBLEMS:
        rank = max(0, int(count / 2 - QUANTILE * np.sqrt(count) / 2))
        median, low, high = np.exp([np.median(ratios), ratios[rank], ratios[count - 1 - rank]])
    return EntryChange(new.problem_set, new.label, new.policy, float(median), float(low), float(high), noise,
                  _solved_only_in(old, new), _solved_only_in(new, old))  # fmt: skip


def _solved_only_in(one: EntryResult, other: EntryResult) -> int:
    """Return how many problems one run solved to an accuracy that the other missed by far, or did not answer."""
    errors = [np.maximum(row.errors, row.violations) / row.scales for row in (one, other)]
    unanswered = np.isnan(errors[1]) & (other.tried == other.problems)
    missed = [(errors[0] <= accuracy) & (unanswered | (errors[1] > EDGE * accuracy)) for accuracy in ACCURACIES]
    return int(np.any(missed, axis=0).sum())


def _run(manifest: Mapping[str, Any]) -> str:
    commit = manifest["git_commit"] or "no commit"
    return f"{manifest['date']}, {commit:.12}, {manifest['processor']}; `{manifest['call']}`"
