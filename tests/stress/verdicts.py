"""Hostile problems for the exact solver: it must end, and every status is checked in exact arithmetic.

`check` verifies each verdict with fractions and times each problem; `watch` gives millions to a process of its
own, for each instruction set, and stops it if one does not end.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing.connection import Connection

import numpy as np

from tensionlab.benchmark.speed import instruction_set
from tensionlab.solvers.base import POLICIES, Answer, Problem, Status
from tensionlab.solvers.least_squares import Newton
from tensionlab.solvers.programs import times
from tensionlab.verification import verify
from tests.stress.exact_check import flaw
from tests.stress.hostile_problems import SHAPES, hostile_problems

TIME_LIMIT = 10e-3  # longest time for one problem, s of this thread alone
BLOCK = 4000  # problems that a watched process solves before it says so ..
PATIENCE = 60.0  # ... and for how long that may take, s. A block takes some 50 ms.
VARIANTS = 16  # wrenches that a rig is given where it is only watched
INSTRUCTION_SETS = ("baseline", "avx2", "avx512")


def check(count: int, seed: int = 0, report: Callable[[str], None] = print) -> Counter[str]:
    """Count statuses and flaws of so many problems under each policy.

    Parameters
    ----------
    count : int
        Problems for each policy, spread over shapes.
    seed : int
    report : callable
        Takes a line for each flaw that is found.

    Returns
    -------
    Counter
        Of statuses by policy, as "force EXACT", and of flaws; "slow" are problems over `TIME_LIMIT`.
    """
    tally: Counter[str] = Counter()
    for n, m in SHAPES:
        rng = np.random.default_rng([seed, n, m])
        problem, inside, kinds = hostile_problems(rng, n, m, -(-count // len(SHAPES)))
        exact: dict[str, bool] = {}
        for row in range(len(problem)):
            for policy in POLICIES:
                one = replace(problem.take(np.array([row])), policy=policy)
                answer, seconds = _timed(one)
                found = verify(one, answer)
                status = Status(int(found.status[0]))
                exact[policy] = status is Status.EXACT
                limits = one.lower[0], one.upper[0]
                verdict = int(status), found.tensions[0], found.separation[0], float(found.scale[0])
                wrong = flaw(one.structure[0], one.wrench[0], limits, policy, verdict, inside[row])
                tally[f"{policy} {status.name}"] += 1
                # The machine itself may take so long, but hardly three times for the same problem.
                if seconds > TIME_LIMIT and min(_timed(one)[1] for _ in range(2)) > TIME_LIMIT:
                    wrong = wrong or "slow"
                if wrong:
                    tally[wrong] += 1
                    report(f"{wrong}: {policy}, {kinds[row]}, {n} x {m}, seed {seed}, problem {row}")
            if exact["force"] and not exact["direction"]:
                tally["force is EXACT, direction is not"] += 1
                report(f"force is EXACT, direction is not: {kinds[row]}, {n} x {m}, seed {seed}, problem {row}")
    return tally


def _timed(one: Problem) -> tuple[Answer, float]:
    began = time.thread_time()
    answer = Newton().solve(one)
    return answer, time.thread_time() - began


def watch(count: int, seed: int = 0, wish: str | None = None, patience: float = PATIENCE) -> tuple[str, int, int]:
    """Solve so many problems under each policy in a process of its own, and stop it if it does not end.

    Parameters
    ----------
    count, seed : int
    wish : {"baseline", "avx2", "avx512"} or None
        The instruction set; a processor without it takes the best that it has.
    patience : float
        For one block of `BLOCK` problems, s.

    Returns
    -------
    name : str
        The instruction set that was used.
    solved, iterations : int
        Problems that ended, under each policy, and the most iterations of one. Less than count: one did not end.
    """
    here, there = multiprocessing.get_context("spawn").Pipe()
    before = os.environ.get("TENSIONLAB_ISA")
    if wish is not None:
        os.environ["TENSIONLAB_ISA"] = wish
    try:
        worker = multiprocessing.get_context("spawn").Process(
            target=_solve, args=(there, count, seed), daemon=True
        )
        worker.start()
    finally:
        if before is not None:
            os.environ["TENSIONLAB_ISA"] = before
        elif wish is not None:
            del os.environ["TENSIONLAB_ISA"]
    there.close()
    name, solved, iterations = "", 0, 0
    try:
        while solved < count and here.poll(patience):
            name, solved, iterations = here.recv()
    except EOFError:
        pass
    worker.kill()
    worker.join()
    return name, solved, iterations


def _solve(tell: Connection, count: int, seed: int) -> None:
    solved, most = 0, 0
    for block in _blocks(seed):
        for policy in POLICIES:
            most = max(most, int(Newton().solve(replace(block, policy=policy)).iterations.max()))
        solved += len(block)
        tell.send((instruction_set(), solved, most))
        if solved >= count:
            return


def _blocks(seed: int) -> Iterator[Problem]:
    """Draw rigs, each with many wrenches at corners and on edges, without end."""
    rng = np.random.default_rng(seed)
    while True:
        for n, m in SHAPES:
            rigs, _, _ = hostile_problems(rng, n, m, BLOCK // VARIANTS)
            many = rigs.take(np.repeat(np.arange(len(rigs)), VARIANTS))
            share = rng.choice((0.0, 0.0, 1.0, 1.0, 0.5, 0.25), many.lower.shape)
            wrench = times(many.structure, many.lower + share * (many.upper - many.lower))
            size = 10.0 ** rng.uniform(-14.0, 0.0, (len(wrench), 1)) * (rng.random((len(wrench), 1)) < 0.7)
            off = rng.normal(size=wrench.shape) * np.maximum(1.0, np.linalg.norm(wrench, axis=1, keepdims=True))
            yield replace(many, wrench=wrench + size * off)


def main() -> None:
    """Run both and print what was found; exit status 1 if a verdict is wrong, or a problem is slow or endless."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=100_000, help="problems to check, for each policy")
    parser.add_argument("--watched", type=int, default=2_000_000, help="problems to watch, for each policy")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    began = time.perf_counter()
    tally = check(asked.count, asked.seed, lambda line: print(line, flush=True))
    statuses = {f"{policy} {status.name}" for policy in POLICIES for status in Status}
    for what, number in sorted(tally.items()):
        print(f"{number:>9,}  {what}")
    flawed = sum(number for what, number in tally.items() if what not in statuses)
    print(f"{asked.count:,} problems x {len(POLICIES)} in {time.perf_counter() - began:.0f} s: {flawed} flaws")
    names: set[str] = set()
    for wish in INSTRUCTION_SETS:
        began = time.perf_counter()
        name, solved, iterations = watch(asked.watched, asked.seed, wish)
        if name in names:
            print(f"{wish}: this processor has none")
            continue
        names.add(name)
        ended = solved >= asked.watched
        flawed += not ended
        end = "all end" if ended else "one of the next does not end"
        print(
            f"{name}: {solved:,} x {len(POLICIES)} in {time.perf_counter() - began:.0f} s, {end}; "
            f"at most {iterations} iterations"
        )
    raise SystemExit(1 if flawed else 0)


if __name__ == "__main__":
    main()
