"""Evaluation of all entries on one problem set: first every answer is verified, then every call is timed.

Problems come in blocks of a group, in a random order that visits all groups early, so that a slow entry, which
runs out of its share of time, has still seen every group. Calls are timed in rounds: blocks, the entries in a
block and its problems each in a new random order, so that all entries share the machine's slow moments. An entry's
first call in a block is not timed: what the others left in the caches is not its fault.
"""

from __future__ import annotations

import gc
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocator
from tensionlab.benchmark import statistics
from tensionlab.benchmark.entries import WRAPPERS, Driver, Entry, driver
from tensionlab.benchmark.optimum import Optimum, excess_error, optimum
from tensionlab.benchmark.problem_sets import ProblemSet, problem_of
from tensionlab.benchmark.results import EntryResult, Evidence, SampledTrajectory, empty_evidence, summarise
from tensionlab.errors import TensionlabError
from tensionlab.solvers import is_built_in
from tensionlab.solvers.base import Answer, Policy, Problem, Status
from tensionlab.support.arrays import Floats
from tensionlab.verification import verify

BLOCK = 20  # problems that an entry answers before it is the next one's turn
BATCH = 10_000  # problems in a timed batch; a group is repeated until it has as many


class SetResults(NamedTuple):
    """The rows of one set, and for how many of its problems the optimum is verified, by policy."""

    rows: list[EntryResult]
    verified: dict[Policy, int]


class Repetitions(NamedTuple):
    """How much time to spend: an entry's seconds in each set, or else on fewer problems; timed calls of each."""

    seconds: float
    repeats: int


class Block(NamedTuple):
    """Some problems of one group: their rows among all problems of the set, and the problems themselves."""

    rows: NDArray[np.intp]
    problem: Problem


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
    trajectories = all(group.path_mm is not None for group in problems.groups)
    policies = {entry.compared_policy for entry in entries}
    best = {policy: [optimum(replace(block.problem, policy=policy)) for block in blocks] for policy in policies}
    scale = np.maximum(1.0, np.concatenate([np.linalg.norm(group.wrench, axis=1) for group in problems.groups]))
    present = [entry for entry in entries if not entry.missing]
    evidence = {each: empty_evidence(scale, effort.repeats) for each in present}
    answered: dict[Entry, tuple[Driver, list[Block]]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # backends warn of what is verified here
        for done, entry in enumerate(present):
            runs = driver(entry)
            gc.collect()
            gc.freeze()  # what the others left is not searched for each
            mine = evidence[entry]
            answered[entry] = (
                runs,
                _answers(runs, entry, blocks, best[entry.compared_policy], mine, effort, trajectories),
            )
            _along_trajectories(problems, mine)
            progress(0.4 * (done + 1) / len(present))
        _time_calls(answered, evidence, effort.repeats, rng, lambda share: progress(0.4 + 0.5 * share))
        for done, entry in enumerate(present):
            if entry.instance is not None and entry.solver.partition(":")[0] not in WRAPPERS:
                allocator = partial(Allocator, solver=entry.instance, policy=entry.policy)
                evidence[entry].batch_s = _time_batch(allocator, answered[entry][1], effort.seconds / 4)
            progress(0.9 + 0.1 * (done + 1) / len(present))
    absent = {each: replace(empty_evidence(scale, 1), note=each.missing) for each in entries if each.missing}
    rows = [summarise(problems.name, each, (evidence | absent)[each]) for each in entries]
    return SetResults(
        rows, {policy: int(sum(each.verified.sum() for each in best[policy])) for policy in policies}
    )


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


def _answers(
    runs: Driver,
    entry: Entry,
    blocks: list[Block],
    best: list[Optimum],
    evidence: Evidence,
    effort: Repetitions,
    consecutive: bool,
) -> list[Block]:
    """Verify the answers to as many blocks as the entry's share of time allows; return those to be timed.

    Along a trajectory all answers are taken, because a figure has all of it; only the timing is spared.
    """
    spent, answered = 0.0, []
    warm: set[tuple[int, ...]] = set()
    for block, target in zip(blocks, best, strict=True):
        if spent > effort.seconds and not consecutive:
            break
        evidence.tried[block.rows] = True
        try:
            if block.problem.structure.shape[1:] not in warm:  # cvxpy compiles each shape once
                runs.call(block.problem, 0)
                warm.add(block.problem.structure.shape[1:])
            began = time.perf_counter()
            found = runs.answers(block.problem)
            call = runs.call(block.problem, 0).call
        except Exception as error:
            evidence.refused[block.rows] = True
            if isinstance(error, (TensionlabError, ValueError)):
                evidence.note = evidence.note or f"refuses some: {str(error).partition('; ')[0]}"
            elif entry.instance is None or is_built_in(entry.solver):
                raise
            else:  # the code of others may raise anything
                evidence.note = evidence.note or f"breaks on some: {type(error).__name__}: {error}"
            continue
        if spent <= effort.seconds:
            answered.append(block)
        spent += time.perf_counter() - began + call * (len(block.rows) + 1) * effort.repeats
        _verify(replace(block.problem, policy=entry.compared_policy), found, entry, target, evidence, block.rows)
    return answered


def _verify(
    problem: Problem, found: Answer, entry: Entry, best: Optimum, evidence: Evidence, rows: NDArray[np.intp]
) -> None:
    """Compare raw answers with the limits and the optimum, and verify the status of a built-in solver."""
    raw = np.array(found.tensions)
    outside = np.maximum(problem.lower - raw, raw - problem.upper).max(axis=1)
    evidence.violation[rows] = np.maximum(outside, 0.0)
    tensions = np.clip(raw, problem.lower, problem.upper)
    evidence.error[rows] = np.maximum(excess_error(problem, best, tensions), 0.0)
    gap = np.abs(tensions - best.tensions).max(axis=1)
    evidence.gap[rows] = np.where(best.verified, gap, np.nan)
    evidence.reachable[rows] = best.reachable
    evidence.iterations[rows] = found.iterations
    if entry.setting == "proved":
        own = replace(problem, policy=entry.policy)
        status = verify(own, replace(found, tensions=tensions)).status
        evidence.proved[rows] = (status == Status.EXACT) | (status == Status.NEAREST)
    evidence.tensions.update(zip(rows.tolist(), tensions, strict=True))


def _along_trajectories(problems: ProblemSet, evidence: Evidence) -> None:
    """Keep the tensions along the trajectory of most redundancy, where objectives differ most, for a figure."""
    start, kept = 0, -1
    for group in problems.groups:
        rows = slice(start, start + len(group.structure))
        start = rows.stop
        n, m = group.structure.shape[1:]
        if group.path_mm is not None and m - n > kept:
            kept = m - n
            nothing = np.full(m, np.nan)
            tensions = np.array([evidence.tensions.get(row, nothing) for row in range(rows.start, rows.stop)])
            evidence.trajectory = SampledTrajectory(group.path_mm, tensions, evidence.reachable[rows])


def _time_calls(
    answered: dict[Entry, tuple[Driver, list[Block]]],
    evidence: dict[Entry, Evidence],
    repeats: int,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> None:
    """Time single calls of all entries in turn."""
    queue: dict[int, tuple[Block, list[Entry]]] = {}
    for entry, (_, blocks) in answered.items():
        for block in blocks:
            queue.setdefault(id(block), (block, []))[1].append(entry)
    turns = list(queue.values())
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        for repeat in range(repeats):
            for done, turn in enumerate(rng.permutation(len(turns))):
                block, selected = turns[turn]
                order = rng.permutation(len(block.rows)).tolist()
                for entry_number in rng.permutation(len(selected)):
                    runs, calls = answered[selected[entry_number]][0], evidence[selected[entry_number]].calls
                    runs.call(block.problem, 0)
                    for row in order:
                        calls[block.rows[row], repeat] = runs.call(block.problem, row)
                gc.collect()
                progress((repeat + (done + 1) / len(turns)) / repeats)
    finally:
        gc.enable()
        gc.unfreeze()


def _time_batch(allocator: Callable[..., Allocator], blocks: list[Block], seconds: float) -> float:
    """Return the time of a problem in one large batch, in s, as the median of three.

    Problems of one shape are one batch, repeated until it has `BATCH` of them, or fewer for a slow solver.
    """
    shapes: dict[tuple[int, ...], list[Problem]] = {}
    for block in blocks:
        shapes.setdefault(block.problem.structure.shape[1:], []).append(block.problem)

    def spend(arrays: list[Floats], size: int) -> float:
        structure, wrench, lower, upper = (array[np.arange(size) % len(array)] for array in arrays)
        prepared = allocator((lower, upper))
        began = time.perf_counter()
        prepared(structure, wrench)
        return time.perf_counter() - began

    total, count = 0.0, 0
    for parts in shapes.values():
        names = ("structure", "wrench", "lower", "upper")
        arrays = [np.concatenate([getattr(part, name) for part in parts]) for name in names]
        own = len(arrays[0])
        affordable = int(own * seconds / len(shapes) / 3 / max(spend(arrays, own), 1e-9))
        size = min(BATCH, max(own, affordable))
        total += statistics.quantile(np.array([spend(arrays, size) for _ in range(3)]), 0.5) * own / size
        count += own
    return total / count if count else float("nan")
