"""Evaluation of all entries on one problem set: first every answer is verified, then every call is timed.

Problems come in blocks of a group, in a random order that visits all groups early, so that a slow entry, which
runs out of its share of time, has still seen every group. Calls are timed in turns, a block each.
"""

from __future__ import annotations

import gc
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocator
from tensionlab.benchmark.entries import WRAPPERS, Driver, Entry, driver
from tensionlab.benchmark.optimum import Optimum, excess_error, optimum
from tensionlab.benchmark.problem_sets import ProblemSet, problem_of
from tensionlab.benchmark.results import ACCURACIES
from tensionlab.benchmark.timing import (
    maximum,
    quantile,
    seconds,
    shifted_geometric_mean,
    take_turns,
    without_collector,
)
from tensionlab.errors import TensionlabError
from tensionlab.solvers import is_built_in
from tensionlab.solvers.base import Answer, Policy, Problem, Status
from tensionlab.support.arrays import Floats
from tensionlab.verification import verify

BLOCK = 20  # problems in a turn of an entry
BATCH = 10_000  # problems in a timed batch; a group is repeated until it has as many


class Repetitions(NamedTuple):
    """Time to spend: an entry's seconds in each set, or else on fewer problems; timed calls of each problem."""

    seconds: float
    repeats: int


class Block(NamedTuple):
    """Some problems of one group: their rows among all problems of the set, and the problems themselves."""

    rows: NDArray[np.intp]
    problem: Problem


@dataclass
class Measurements:
    """Measurements of one entry on P problems, R times each; NaN where there are none.

    Attributes
    ----------
    values : dict of (P,) arrays
        By the names in `results.QUANTITIES`, those of times apart; ``path_mm`` and ``tension.00``, ... of one
        trajectory.
    calls : (P, R, 4) array
        Times in s: call, and its parts build, setup and solve.
    timed : list of Block
        Problems that were answered within the entry's share of time.
    """

    entry: Entry
    values: dict[str, Floats]
    calls: Floats
    timed: list[Block] = field(default_factory=list)
    note: str = ""
    batch_s: float = np.nan

    def best_calls(self) -> Floats:
        """Return the fastest call of each problem with its parts, (P, 4)."""
        walls = np.where(np.isnan(self.calls[:, :, 0]), np.inf, self.calls[:, :, 0])
        return np.asarray(np.take_along_axis(self.calls, walls.argmin(axis=1)[:, None, None], axis=1)[:, 0])


class SetResults(NamedTuple):
    """Rows of `results.Results` and of its measurements, and for how many problems the optimum is verified."""

    rows: list[dict[str, Any]]
    measurements: list[dict[str, Any]]
    verified: dict[Policy, int]


def evaluate_set(
    problems: ProblemSet,
    entries: Sequence[Entry],
    effort: Repetitions,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> SetResults:
    """Verify and time the answers of all entries to one set.

    ``rng`` shuffles, and ``progress`` is called with the share that is done. Rows are in the order of the entries.
    """
    blocks = _blocks(problems, rng)
    policies = {entry.compared_policy for entry in entries}
    best = {policy: [optimum(replace(block.problem, policy=policy)) for block in blocks] for policy in policies}
    scale = np.maximum(1.0, np.concatenate([np.linalg.norm(group.wrench, axis=1) for group in problems.groups]))
    path = _path_lengths(problems)
    measured = [no_measurements(entry, scale, effort.repeats, path) for entry in entries]
    present = [(each, driver(each.entry)) for each in measured if not each.entry.missing]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # backends warn of what is verified here
        for done, (each, runs) in enumerate(present, start=1):
            gc.collect()
            _answer(each, runs, blocks, best[each.entry.compared_policy], effort)
            progress(0.4 * done / len(present))
        _time_calls(present, effort.repeats, rng, lambda share: progress(0.4 + 0.5 * share))
        for done, (each, _) in enumerate(present, start=1):
            entry = each.entry
            if entry.instance is not None and entry.solver.partition(":")[0] not in WRAPPERS:
                allocator = partial(Allocator, solver=entry.instance, policy=entry.policy)
                each.batch_s = _time_batch(allocator, each.timed, effort.seconds / 4)
            progress(0.9 + 0.1 * done / len(present))
    tables = [
        each.entry.key(problems.name)
        | {"problem": np.arange(len(scale)), "call_s": each.best_calls()[:, 0]}
        | each.values
        for each, _ in present
    ]
    verified = {policy: int(sum(block.verified.sum() for block in best[policy])) for policy in policies}
    return SetResults([summarise(problems.name, each) for each in measured], tables, verified)


def no_measurements(entry: Entry, scale: Floats, repeats: int, path_mm: Floats | None = None) -> Measurements:
    """Return measurements without values, for as many problems as there are scales."""
    zeros = {name: np.zeros(len(scale)) for name in ("tried", "refused", "reachable", "proved", "iterations")}
    empty = {name: np.full(len(scale), np.nan) for name in ("error", "violation", "gap")}
    values = {**zeros, **empty, "scale": scale} | ({} if path_mm is None else {"path_mm": path_mm})
    return Measurements(entry, values, np.full((len(scale), repeats, 4), np.nan), note=entry.missing)


def summarise(problem_set: str, measured: Measurements) -> dict[str, Any]:
    """Return the row of `results.Results` of one entry on a problem set."""
    entry, values, best = measured.entry, measured.values, measured.best_calls()
    call, build, setup, solve = best.T
    tried = int(values["tried"].sum())
    error = np.maximum(values["error"], values["violation"]) / values["scale"]
    shares = {f"solved_1e{-np.log10(limit):.0f}": (error <= limit).sum() for limit in ACCURACIES}
    return {
        **entry.key(problem_set),
        "objective": entry.objective,
        "comparable": entry.comparable,
        "note": measured.note,
        "problems": len(best),
        "tried": tried,
        "refused": int(values["refused"].sum()),
        "failed": int(((values["tried"] > values["refused"]) & np.isnan(values["error"])).sum()),
        "proved": int(values["proved"].sum()),
        **{name: float(count / tried) if tried else np.nan for name, count in shares.items()},
        "error_max": maximum(values["error"]),
        "violation_max": maximum(values["violation"]),
        "gap_median": quantile(values["gap"], 0.5),
        "gap_max": maximum(values["gap"]),
        "sgm_s": shifted_geometric_mean(call),
        "prebuilt_s": shifted_geometric_mean(call - build),
        "median_s": quantile(call, 0.5),
        "p99_s": quantile(call, 0.99),
        "p999_s": quantile(call, 0.999),
        "worst_s": maximum(call),
        "jitter_s": maximum(measured.calls[:, :, 0]),
        "build_s": quantile(build, 0.5),
        "setup_s": quantile(setup, 0.5),
        "solve_s": quantile(solve, 0.5),
        "batch_s": measured.batch_s,
        "iterations_max": int(values["iterations"].max(initial=0)),
    }


def _blocks(problems: ProblemSet, rng: np.random.Generator) -> list[Block]:
    """Return all problems in blocks, shuffled, but so that the groups take turns."""
    dealt: list[tuple[float, Block]] = []
    start = 0
    for group in problems.groups:
        problem, size = problem_of(group), len(group.structure)
        # Neighbours are often alike, and a slow entry should see of everything; a figure has a whole trajectory.
        order = np.arange(size) if group.path_mm is not None else rng.permutation(size)
        pieces = [order[first : first + BLOCK] for first in range(0, size, BLOCK)]
        # The k-th of K pieces comes at about k/K of the way.
        turns = (rng.permutation(len(pieces)) + rng.random(len(pieces))) / max(1, len(pieces))
        dealt += [
            (float(turn), Block(start + rows, problem.take(rows)))
            for turn, rows in zip(turns, pieces, strict=True)
        ]
        start += size
    return [block for _, block in sorted(dealt, key=lambda pair: pair[0])]


def _path_lengths(problems: ProblemSet) -> Floats | None:
    """Return the length of the path so far, (P,) in mm, of the trajectory of most redundancy; NaN elsewhere.

    There objectives differ most. None if there is no trajectory.
    """
    redundancy = [
        -1 if group.path_mm is None else group.structure.shape[2] - group.structure.shape[1]
        for group in problems.groups
    ]
    drawn = int(np.argmax(redundancy))
    if problems.groups[drawn].path_mm is None:
        return None
    lengths = [np.full(len(group.structure), np.nan) for group in problems.groups]
    lengths[drawn] = np.asarray(problems.groups[drawn].path_mm, dtype=np.float64)
    return np.concatenate(lengths)


def _answer(
    measured: Measurements, runs: Driver, blocks: list[Block], best: list[Optimum], effort: Repetitions
) -> None:
    """Verify the answers to as many blocks as the entry's share of time allows, and note those to be timed.

    Along trajectories all answers are taken, because a figure has all of one; only the timing is spared.
    """
    entry, values, spent = measured.entry, measured.values, 0.0
    warm: set[tuple[int, ...]] = set()
    for block, target in zip(blocks, best, strict=True):
        if spent > effort.seconds and "path_mm" not in values:
            break
        values["tried"][block.rows] = 1.0
        try:
            if block.problem.structure.shape[1:] not in warm:  # cvxpy compiles each shape once
                runs.call(block.problem, 0)
                warm.add(block.problem.structure.shape[1:])
            began = time.perf_counter()
            answer = runs.answers(block.problem)
            call = runs.call(block.problem, 0).call
        except Exception as error:
            values["refused"][block.rows] = 1.0
            if isinstance(error, (TensionlabError, ValueError)):
                measured.note = measured.note or f"refuses some: {str(error).partition('; ')[0]}"
            elif entry.instance is None or is_built_in(entry.solver):
                raise
            else:  # the code of others may raise anything
                measured.note = measured.note or f"breaks on some: {type(error).__name__}: {error}"
            continue
        if spent <= effort.seconds:
            measured.timed.append(block)
        spent += time.perf_counter() - began + call * (len(block.rows) + 1) * effort.repeats
        _verify(measured, block, answer, target)


def _verify(measured: Measurements, block: Block, answer: Answer, best: Optimum) -> None:
    """Compare raw answers with limits and optimum, and verify those of a solver."""
    entry, rows, values = measured.entry, block.rows, measured.values
    problem = replace(block.problem, policy=entry.compared_policy)
    raw = np.array(answer.tensions)
    outside = np.maximum(problem.lower - raw, raw - problem.upper).max(axis=1)
    tensions = np.clip(raw, problem.lower, problem.upper)
    gap = np.abs(tensions - best.tensions).max(axis=1)
    values["violation"][rows] = np.maximum(outside, 0.0)
    values["error"][rows] = np.maximum(excess_error(problem, best, tensions), 0.0)
    values["gap"][rows] = np.where(best.verified, gap, np.nan)
    values["reachable"][rows] = best.reachable
    values["iterations"][rows] = answer.iterations
    if entry.setting == "proved":
        own = replace(problem, policy=entry.policy)
        status = verify(own, replace(answer, tensions=tensions)).status
        values["proved"][rows] = (status == Status.EXACT) | (status == Status.NEAREST)
    if "path_mm" in values and np.isfinite(values["path_mm"][rows[0]]):
        for cable, column in enumerate(tensions.T):
            nothing = np.full(len(values["path_mm"]), np.nan)
            values.setdefault(f"tension.{cable:02}", nothing)[rows] = column


def _time_calls(
    present: Sequence[tuple[Measurements, Driver]],
    repeats: int,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> None:
    """Time single calls of all entries, in turns of a block."""
    callers: dict[int, tuple[Block, dict[int, Callable[[int], tuple[float, ...]]]]] = {}
    for number, (measured, runs) in enumerate(present):
        for block in measured.timed:
            callers.setdefault(id(block), (block, {}))[1][number] = partial(runs.call, block.problem)
    turns = list(callers.values())
    with without_collector():
        for repeat in range(repeats):
            for done, turn in enumerate(rng.permutation(len(turns))):
                block, mine = turns[turn]
                for number, row, times in take_turns([(range(len(block.rows)), mine)], rng):
                    present[number][0].calls[block.rows[row], repeat] = times
                gc.collect()
                progress((repeat + (done + 1) / len(turns)) / repeats)


def _time_batch(allocator: Callable[..., Allocator], blocks: list[Block], budget_s: float) -> float:
    """Return the time of a problem in one large batch, in s, as the median of three.

    Problems of one shape are one batch, repeated until it has `BATCH` of them, or fewer for a slow solver.
    """
    shapes: dict[tuple[int, ...], list[Problem]] = {}
    for block in blocks:
        shapes.setdefault(block.problem.structure.shape[1:], []).append(block.problem)

    def spend(arrays: list[Floats], size: int) -> float:
        structure, wrench, lower, upper = (array[np.arange(size) % len(array)] for array in arrays)
        return seconds(allocator((lower, upper)), structure, wrench)

    total, count = 0.0, 0
    for parts in shapes.values():
        arrays = [np.concatenate(column) for column in zip(*(part.arrays[:4] for part in parts), strict=True)]
        own = len(arrays[0])
        affordable = int(own * budget_s / len(shapes) / 3 / max(spend(arrays, own), 1e-9))
        size = min(BATCH, max(own, affordable))
        total += quantile(np.array([spend(arrays, size) for _ in range(3)]), 0.5) * own / size
        count += own
    return total / count if count else float("nan")
