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
from tensionlab.benchmark.entries import LEAST_SQUARES, WRAPPERS, CallTimes, Driver, Entry, GuardedSolver, driver
from tensionlab.benchmark.optimum import Optimum, deviations, optimum
from tensionlab.benchmark.problem_sets import ProblemSet, problem_of
from tensionlab.benchmark.results import ACCURACIES, QUANTITIES
from tensionlab.benchmark.speed import quantile, seconds, shifted_geometric_mean, take_turns, without_collector
from tensionlab.errors import TensionlabError
from tensionlab.solvers.base import Answer, Policy, Problem, Status
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats
from tensionlab.verification import verify

BLOCK = 20  # problems in a turn of an entry
BATCH = 10_000  # problems in a timed batch; a group is repeated until it has as many
COUNTED = ("tried", "refused", "proved", "reachable", "iterations")  # quantities that are 0 where not measured


class Block(NamedTuple):
    """Some problems of one group: their rows among all problems of the set, and the problems themselves."""

    rows: NDArray[np.intp]
    problem: Problem


@dataclass
class Measurements:
    """Measurements of one entry on P problems."""

    entry: Entry
    values: dict[str, Floats]  # (P,) arrays by the names in `results.QUANTITIES`, NaN where none
    timed: list[Block] = field(default_factory=list)  # problems answered within the entry's share of time
    note: str = ""
    batch_s: float = np.nan


class SetResults(NamedTuple):
    """Rows of `results.Results` and of its measurements, and for how many problems the optimum is verified."""

    rows: list[dict[str, Any]]
    measurements: list[dict[str, Any]]
    verified: dict[Policy, int]


def evaluate_set(
    problems: ProblemSet,
    entries: Sequence[Entry],
    budget_s: float,
    repeats: int,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> SetResults:
    """Verify and time the answers of all entries to one set.

    Each entry has ``budget_s``, or else answers fewer problems; each call is timed ``repeats`` times. ``rng``
    shuffles, and ``progress`` is called with the share that is done. Rows are in the order of the entries.
    """
    blocks = _blocks(problems, rng)
    policies = {entry.compared_policy for entry in entries}
    best = {policy: [optimum(replace(block.problem, policy=policy)) for block in blocks] for policy in policies}
    scale = np.maximum(1.0, np.concatenate([np.linalg.norm(group.wrench, axis=1) for group in problems.groups]))
    measured = [no_measurements(entry, scale) for entry in entries]
    present = [(record, driver(record.entry)) for record in measured if not record.entry.missing]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # backends warn of what is verified here
        with without_collector():
            for done, (record, runs) in enumerate(present, start=1):
                gc.collect()
                _answer(record, runs, blocks, best[record.entry.compared_policy], budget_s, repeats)
                progress(0.4 * done / len(present))
        _time_calls(present, repeats, rng, lambda share: progress(0.4 + 0.5 * share))
        for done, (record, _) in enumerate(present, start=1):
            entry = record.entry
            if entry.instance is not None and entry.solver.partition(":")[0] not in WRAPPERS:
                allocator = partial(Allocator, solver=entry.instance, policy=entry.policy)
                record.batch_s = _time_batch(allocator, record.timed, budget_s / 4)
            progress(0.9 + 0.1 * done / len(present))
    numbers = {"problem": np.arange(len(scale))}
    tables = [record.entry.key(problems.name) | numbers | record.values for record, _ in present]
    verified = {policy: int(sum(block.verified.sum() for block in best[policy])) for policy in policies}
    return SetResults([summarise(problems.name, record) for record in measured], tables, verified)


def no_measurements(entry: Entry, scale: Floats) -> Measurements:
    """Return measurements without values, for as many problems as there are scales."""
    values = {name: np.full(len(scale), 0.0 if name in COUNTED else np.nan) for name in QUANTITIES}
    return Measurements(entry, values | {"scale": scale}, note=entry.missing)


def summarise(problem_set: str, measured: Measurements) -> dict[str, Any]:
    """Return the row of `results.Results` of one entry on a problem set."""
    entry, values = measured.entry, provenance.data_frame(measured.values)
    largest, total, call = values.max(), values.sum(), measured.values["call_s"]
    tried = int(total["tried"])
    error = np.maximum(values["error"], values["violation"]) / values["scale"]
    shares = {f"solved_1e{-np.log10(limit):.0f}": (error <= limit).sum() for limit in ACCURACIES}
    return {
        **entry.key(problem_set),
        "objective": entry.objective,
        "comparable": entry.objective == LEAST_SQUARES,
        "note": measured.note,
        "problems": len(values),
        "tried": tried,
        "refused": int(total["refused"]),
        "failed": int(((values["tried"] > values["refused"]) & values["error"].isna()).sum()),
        "proved": int(total["proved"]),
        **{name: float(count / tried) if tried else np.nan for name, count in shares.items()},
        "error_max": largest["error"],
        "violation_max": largest["violation"],
        "gap_median": quantile(measured.values["gap"], 0.5),
        "gap_max": largest["gap"],
        "sgm_s": shifted_geometric_mean(call),
        "prebuilt_s": shifted_geometric_mean(call - measured.values["build_s"]),
        "own_s": shifted_geometric_mean(measured.values["own_s"]),
        "median_s": quantile(call, 0.5),
        "p99_s": quantile(call, 0.99),
        "p999_s": quantile(call, 0.999),
        "worst_s": largest["call_s"],
        "build_s": quantile(measured.values["build_s"], 0.5),
        "batch_s": measured.batch_s,
        "iterations_max": int(largest["iterations"]),
    }


def _blocks(problems: ProblemSet, rng: np.random.Generator) -> list[Block]:
    """Return all problems in shuffled blocks, because neighbours are often alike, the groups in turn."""
    dealt: list[tuple[float, Block]] = []
    start = 0
    for group in problems.groups:
        problem, order = problem_of(group), rng.permutation(len(group.structure))
        pieces = [order[first : first + BLOCK] for first in range(0, len(order), BLOCK)]
        # The k-th of K pieces comes at about k/K of the way.
        turns = (rng.permutation(len(pieces)) + rng.random(len(pieces))) / max(1, len(pieces))
        blocks = [Block(start + rows, problem.take(rows)) for rows in pieces]
        dealt += zip(turns.tolist(), blocks, strict=True)
        start += len(order)
    return [block for _, block in sorted(dealt, key=lambda pair: pair[0])]


def _answer(
    measured: Measurements, runs: Driver, blocks: list[Block], best: list[Optimum], budget_s: float, repeats: int
) -> None:
    """Verify the answers to as many blocks as the entry's share of time allows."""
    values, spent = measured.values, 0.0
    warm: set[tuple[int, ...]] = set()
    for block, target in zip(blocks, best, strict=True):
        if spent > budget_s:
            break
        values["tried"][block.rows] = 1.0
        try:
            if block.problem.structure.shape[1:] not in warm:  # cvxpy compiles each shape once
                runs.call(block.problem, 0)
                warm.add(block.problem.structure.shape[1:])
            began = time.perf_counter()
            answer = runs.answers(block.problem)
            call = runs.call(block.problem, 0).call_s
        except (TensionlabError, ValueError) as error:
            values["refused"][block.rows] = 1.0
            measured.note = measured.note or f"refuses some: {str(error).partition('; ')[0]}"
            continue
        if isinstance(measured.entry.instance, GuardedSolver) and answer.failures:
            measured.note = measured.note or f"breaks on some: {next(iter(answer.failures.values()))}"
        measured.timed.append(block)
        spent += time.perf_counter() - began + call * (len(block.rows) + 1) * repeats
        _verify(measured, block, answer, target)


def _verify(measured: Measurements, block: Block, answer: Answer, best: Optimum) -> None:
    """Compare raw answers with limits and optimum, and verify those of a solver."""
    entry, rows, values = measured.entry, block.rows, measured.values
    problem = replace(block.problem, policy=entry.compared_policy)
    for name, deviation in deviations(problem, best, answer.tensions).items():
        values[name][rows] = deviation
    values["reachable"][rows] = best.reachable
    values["iterations"][rows] = answer.iterations
    if entry.setting == "proved":
        status = verify(replace(problem, policy=entry.policy), answer).status
        values["proved"][rows] = (status == Status.EXACT) | (status == Status.NEAREST)


def _time_calls(
    present: Sequence[tuple[Measurements, Driver]],
    repeats: int,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> None:
    """Time single calls of all entries, in turns of a block; the fastest call of each problem counts."""
    callers: dict[int, tuple[Block, dict[int, Callable[[int], CallTimes]]]] = {}
    for number, (measured, runs) in enumerate(present):
        for block in measured.timed:
            callers.setdefault(id(block), (block, {}))[1][number] = partial(runs.call, block.problem)
    turns = list(callers.values())
    with without_collector():
        for repeat in range(repeats):
            for done, turn in enumerate(rng.permutation(len(turns))):
                block, mine = turns[turn]
                for number, row, times in take_turns([(range(len(block.rows)), mine)], rng):
                    values, problem = present[number][0].values, block.rows[row]
                    if not times.call_s >= values["call_s"][problem]:
                        for name, time_s in times._asdict().items():
                            values[name][problem] = time_s
                gc.collect()
                progress((repeat + (done + 1) / len(turns)) / repeats)


def _time_batch(allocator: Callable[..., Allocator], blocks: list[Block], budget_s: float) -> float:
    """Return the time of a problem, in s, in batches of one shape: the median of three; fewer if it is slow."""
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
