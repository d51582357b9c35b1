"""One problem set, all contestants: first every answer, then every clock.

Problems come in blocks of `BLOCK` of a group: any of them, or consecutive ones along a trajectory. Blocks are
asked in a random order that visits all groups early, so that a slow contestant, which runs out of its share of
time, has still seen every group. Then `clock` times them.
"""

from __future__ import annotations

import gc
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tensionlab.benchmark import statistics
from tensionlab.benchmark.clock import Block, time_batch, time_calls
from tensionlab.benchmark.drivers import Driver, driver
from tensionlab.benchmark.entries import PROGRAMS, Contestant
from tensionlab.benchmark.optimum import Optimum, error_above_least, optimum
from tensionlab.benchmark.problem_sets import Group, ProblemSet
from tensionlab.benchmark.rows import Evidence, Path, Row, empty_evidence, summarise
from tensionlab.errors import TensionlabError
from tensionlab.solvers.base import POLICIES, Answer, Nearest, Problem, Status
from tensionlab.verification import verify

BLOCK = 20
"""Problems that a contestant answers before it is the next one's turn."""


@dataclass(frozen=True)
class Measured:
    """The rows of one set, and for how many of its problems the optimum is verified, by policy."""

    rows: list[Row]
    verified: dict[Nearest, int]


@dataclass(frozen=True)
class Effort:
    """How much to spend.

    Attributes
    ----------
    seconds : float
        A contestant's share of time in each set. One that needs longer is measured on fewer problems.
    repeats : int
        Timed calls for each problem.
    """

    seconds: float
    repeats: int


def measure_set(
    problems: ProblemSet,
    contestants: Sequence[Contestant],
    effort: Effort,
    rng: np.random.Generator,
    progress: Callable[[float], None],
) -> Measured:
    """What does every contestant answer on one set, and how long does it take?

    Parameters
    ----------
    problems : ProblemSet
    contestants : sequence of Contestant
    effort : Effort
    rng : Generator
        Shuffles.
    progress : callable
        Told the share that is done.

    Returns
    -------
    Measured
        Rows in the order of the contestants.
    """
    blocks = _blocks(problems, rng)
    trajectories = all(group.path_mm is not None for group in problems.groups)
    policies = {policy_of(contestant) for contestant in contestants}
    best = {policy: [optimum(replace(block.problem, nearest=policy)) for block in blocks] for policy in policies}
    scale = np.maximum(1.0, np.concatenate([np.linalg.norm(group.wrench, axis=1) for group in problems.groups]))
    present = [contestant for contestant in contestants if not contestant.missing]
    evidence = {each: empty_evidence(scale, effort.repeats) for each in present}
    asked: dict[Contestant, tuple[Driver, list[Block]]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # backends warn of what is measured here
        for done, contestant in enumerate(present):
            ask = driver(contestant)
            gc.collect()
            targets, mine = best[policy_of(contestant)], evidence[contestant]
            asked[contestant] = ask, _answers(ask, contestant, blocks, targets, mine, effort, trajectories)
            _along_paths(problems, mine)
            progress(0.4 * (done + 1) / len(present))
        time_calls(asked, evidence, effort.repeats, rng, lambda share: progress(0.4 + 0.5 * share))
        for done, contestant in enumerate(present):
            if contestant.setting == "proved" and contestant.solver.partition(":")[0] not in PROGRAMS:
                evidence[contestant].batch_s = time_batch(contestant, asked[contestant][1], effort.seconds / 4)
            progress(0.9 + 0.1 * (done + 1) / len(present))
    absent = {each: replace(empty_evidence(scale, 1), note=each.missing) for each in contestants if each.missing}
    rows = [summarise(problems.name, each, (evidence | absent)[each]) for each in contestants]
    return Measured(rows, {policy: int(sum(each.verified.sum() for each in best[policy])) for policy in policies})


def policy_of(contestant: Contestant) -> Nearest:
    """By which policy are its answers judged? One that honours none is held against the closest wrench."""
    return contestant.nearest or POLICIES[0]


def whole(group: Group) -> Problem:
    """The problems of a group: reference 0, no weights; the policy is the contestant's to choose."""
    size, n, m = group.structure.shape
    return Problem(
        structure=group.structure,
        wrench=group.wrench,
        lower=np.broadcast_to(group.lower, (size, m)),
        upper=np.broadcast_to(group.upper, (size, m)),
        reference=np.zeros((size, m)),
        weights=np.ones(n),
        nearest=None,
    )


def _blocks(problems: ProblemSet, rng: np.random.Generator) -> list[Block]:
    """All problems in blocks, shuffled, but so that the groups take turns."""
    dealt: list[tuple[float, Block]] = []
    start = 0
    for group in problems.groups:
        problem, size = whole(group), len(group.structure)
        # Neighbours are often alike, and a slow contestant should see of everything; but jumps need neighbours.
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
    ask: Driver,
    contestant: Contestant,
    blocks: list[Block],
    best: list[Optimum],
    evidence: Evidence,
    effort: Effort,
    consecutive: bool,
) -> list[Block]:
    """Take the answers to as many blocks as the contestant's share of time allows; which ones are to be timed.

    Along a trajectory all answers are taken, because a jump needs both its sides; only the clock is spared.
    """
    spent, answered = 0.0, []
    warm: set[tuple[int, ...]] = set()
    for block, target in zip(blocks, best, strict=True):
        if spent > effort.seconds and not consecutive:
            break
        evidence.tried[block.rows] = True
        try:
            if block.problem.structure.shape[1:] not in warm:  # cvxpy compiles each shape once
                ask.call(block.problem, 0)
                warm.add(block.problem.structure.shape[1:])
            began = time.perf_counter()
            found = ask.answers(block.problem)
            call = ask.call(block.problem, 0).call
        except (TensionlabError, ValueError) as error:
            evidence.refused[block.rows] = True
            evidence.note = evidence.note or f"refuses some: {str(error).partition('; ')[0]}"
            continue
        if spent <= effort.seconds:
            answered.append(block)
        spent += time.perf_counter() - began + call * (len(block.rows) + 1) * effort.repeats
        _judge(replace(block.problem, nearest=policy_of(contestant)), found, contestant, target, evidence, block)
    return answered


def _judge(
    problem: Problem, found: Answer, contestant: Contestant, best: Optimum, evidence: Evidence, block: Block
) -> None:
    """Hold raw answers against the limits, the optimum and, for a solver of the house, the interface's proof."""
    raw, rows = np.array(found.tensions), block.rows
    outside = np.maximum(problem.lower - raw, raw - problem.upper).max(axis=1)
    evidence.violation[rows] = np.maximum(outside, 0.0)
    tensions = np.clip(raw, problem.lower, problem.upper)
    evidence.error[rows] = np.maximum(error_above_least(problem, best, tensions), 0.0)
    gap = np.abs(tensions - best.tensions).max(axis=1)
    evidence.gap[rows] = np.where(best.verified, gap, np.nan)
    evidence.reachable[rows] = best.reachable
    evidence.iterations[rows] = found.iterations
    if contestant.setting == "proved":
        judged = replace(problem, nearest=contestant.nearest)
        status = verify(judged, replace(found, tensions=tensions)).status
        evidence.proved[rows] = (status == Status.EXACT) | (status == Status.NEAREST)
    evidence.tensions.update(zip(rows.tolist(), tensions, strict=True))


def _along_paths(problems: ProblemSet, evidence: Evidence) -> None:
    """Note how much the tensions jump along each trajectory, and keep one for a picture.

    The one of most redundancy, where objectives differ most.
    """
    start, kept = 0, -1
    for group in problems.groups:
        rows = slice(start, start + len(group.structure))
        start = rows.stop
        if group.path_mm is None:
            continue
        n, m = group.structure.shape[1:]
        nothing = np.full(m, np.nan)
        tensions = np.array([evidence.tensions.get(row, nothing) for row in range(rows.start, rows.stop)])
        evidence.jumps.append(statistics.jumps(tensions, group.path_mm))
        if m - n > kept:
            kept = m - n
            evidence.path = Path(group.path_mm, tensions, evidence.reachable[rows])
