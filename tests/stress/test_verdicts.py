"""Verdicts of the exact solver on hostile problems, checked in exact arithmetic; and that wrong ones are found."""

import os
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from tensionlab import _native
from tensionlab.solvers.base import POLICIES, Status
from tensionlab.solvers.least_squares import Newton
from tensionlab.verification import verify
from tests.stress import cases
from tests.stress.exact_check import flaw
from tests.stress.hostile_problems import SHAPES, hostile_problems

TIME_LIMIT_S = 10e-3  # longest time for one problem, of this thread alone
BLOCK_LIMIT_S = 60.0  # longest time for a block of problems, which takes some 0.1 s and the start of a process
BLOCK = """
from tests.stress.hostile_problems import solve_blocks
print(solve_blocks({count}, {seed}))
"""


def timed(one):
    began = time.thread_time()
    answer = Newton().solve(one)
    return answer, time.thread_time() - began


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_every_verdict_is_right_and_none_takes_long(shape):
    count, tally = cases(50), Counter()
    problem, inside, _ = hostile_problems(np.random.default_rng([3, *shape]), *shape, count)
    for row in range(count):
        exact = {}
        for policy in POLICIES:
            one = replace(problem.take(np.array([row])), policy=policy)
            answer, seconds = timed(one)
            found = verify(one, answer)
            verdict = int(found.status[0]), found.tensions[0], found.separation[0], float(found.scale[0])
            limits = one.lower[0], one.upper[0]
            wrong = flaw(one.structure[0], one.wrench[0], limits, policy, verdict, inside[row])
            assert wrong is None, f"{wrong}: {policy}, row {row}"
            # The machine itself may take that long, but hardly three times for the same problem.
            assert seconds < TIME_LIMIT_S or min(timed(one)[1] for _ in range(2)) < TIME_LIMIT_S, (row, policy)
            tally[Status(verdict[0])] += 1
            exact[policy] = verdict[0] == Status.EXACT
        assert exact["direction"] or not exact["force"], row
    assert min(tally[Status.EXACT], tally[Status.NEAREST]) > 0
    assert tally[Status.UNPROVEN] <= 2 + 0.02 * count, "under three policies"


@pytest.mark.parametrize("name", _native.INSTRUCTION_SETS)
def test_every_instruction_set_ends_on_every_problem(name):
    for seed in range(cases(1)):
        words = [sys.executable, "-c", BLOCK.format(count=len(SHAPES), seed=seed)]
        environment = os.environ | {"TENSIONLAB_ISA": name}
        run = subprocess.run(
            words, env=environment, capture_output=True, text=True, check=True, timeout=BLOCK_LIMIT_S
        )
        assert int(run.stdout) <= 2500, "iterations"


@pytest.mark.parametrize("policy", POLICIES)
def test_a_verdict_that_is_off_by_little_is_found_out(policy):
    problem, inside, _ = hostile_problems(np.random.default_rng(5), 3, 4, 300, policy)
    found = verify(problem, Newton().solve(problem))
    caught = Counter()
    for i in range(300):
        W, w, limits = problem.structure[i], problem.wrench[i], (problem.lower[i], problem.upper[i])
        t, d, s = found.tensions[i], found.separation[i], float(found.scale[i])
        beyond = np.nextafter(limits[1], np.inf)
        caught["limits"] += flaw(W, w, limits, policy, (0, beyond, d, s)) == "tensions beyond their limits"
        wrong = flaw(W, w, limits, policy, (1, t, d, s), inside[i])
        caught["feasible"] += wrong == "NEAREST, and the wrench is feasible"
        if found.status[i] == Status.NEAREST:
            caught["exact"] += flaw(W, w, limits, policy, (0, t, d, 1.0)) is not None
            caught["direction"] += flaw(W, w, limits, policy, (1, t, -d, s)) is not None
            poor = limits[0] + 0.5 * (limits[1] - limits[0])
            caught["nearer"] += flaw(W, w, limits, policy, (1, poor, d, s)) is not None
    nearest = int((found.status == Status.NEAREST).sum())
    assert caught["limits"] == 300
    assert caught["exact"] == caught["direction"] == nearest > 50
    assert caught["nearer"] > 0.5 * nearest
    assert caught["feasible"] > 50
