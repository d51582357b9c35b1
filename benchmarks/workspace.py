"""Times of the workspace metrics, and agreement with a linear program for each pose.

`python -m benchmarks.workspace` times them, on one core and on all, and HiGHS and NumPy in turn;
with `--verify` it compares the sign of the capacity margin with feasibility by HiGHS at 100,000 random poses, and
what is required of suspended robots, weight and pushes, with `scipy.optimize.linprog` at 10,000 poses each.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import highs
from tensionlab.benchmark.rigs import rotations, structures, unit_vectors
from tensionlab.benchmark.speed import describe_kernels, using_threads
from tensionlab.model.files import load_rig
from tensionlab.model.requirement import Requirement
from tensionlab.support.arrays import Floats
from tensionlab.workspace import PoseList, capacity_margin, wrench_closure
from tensionlab.workspace.structure_metrics import feasibility_tolerance
from tensionlab.workspace.sweep import sweep

LOWER, UPPER = 0.5, 6.0
SHAPES = ((2, 4), (3, 4), (3, 8), (6, 8))  # components and cables of the verification
# Margins this close to zero are left out of the verification: HiGHS itself has a tolerance of 1e-7.
UNDECIDED_MARGIN_N = 1e-6
SUSPENDED = ("cogiro", "caroca", "fast")  # robots of the verification that hang from their cables
PUSH_SHARE = 0.1  # of the weight: how hard they are pushed along each axis
TILT = np.radians(10.0)  # they are turned by up to this angle
BASELINE_CALLS = 400  # linear programs in each round


@dataclass(frozen=True)
class Row:
    """Seconds a pose, each the best of the rounds.

    Attributes
    ----------
    name : str
    poses, cores : int
    one_core_s, all_cores_s : float
        In one call over all poses.
    numpy_s : float
        Null space by `numpy.linalg.svd`, all poses at once; NaN where there is none.
    highs_s, linprog_s : float
        One linear program a pose: HiGHS's own module, its models ready, and `scipy.optimize.linprog`.
    """

    name: str
    poses: int
    cores: int
    one_core_s: float
    all_cores_s: float
    numpy_s: float
    highs_s: float
    linprog_s: float


def margin_row(n: int, m: int, count: int, rounds: int, seed: int = 0) -> Row:
    """Return the times of the capacity margin about zero at random poses."""
    W = structures(np.random.default_rng(seed), n, m, count)
    limits = np.full(m, LOWER), np.full(m, UPPER)
    return _row(f"capacity margin, n = {n}, m = {m}", W, limits, lambda: capacity_margin(W, limits), None, rounds)


def closure_row(step: float, rounds: int) -> Row:
    """Return the times of wrench closure over the published grid of IPAnema 2, for a step in m."""
    rig = load_rig("ipanema-2")
    axes = [np.arange(-4.0, 4.0 + step / 2, step), np.arange(-3.0, 3.0 + step / 2, step), np.arange(2.0, 4.5)]
    W = rig.structure_matrix(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
    pulling = np.ones(rig.m), np.full(rig.m, np.inf)
    found, expected = wrench_closure(W), closure_by_svd(W)
    if not np.array_equal(found, expected):
        raise AssertionError(f"NumPy's null space contradicts {np.count_nonzero(found != expected)} poses")
    return _row(
        "wrench closure, IPAnema 2", W, pulling, lambda: wrench_closure(W), lambda: closure_by_svd(W), rounds
    )


def closure_by_svd(structure: Floats) -> NDArray[np.bool_]:
    """Return which poses have wrench closure, by singular values; two more cables than components.

    Positive tensions N x in the null space are there if the rows of its basis N fit in an open half-plane: if the
    largest angle between neighbours is more than a half turn.

    Parameters
    ----------
    structure : (B, n, n + 2) array

    Returns
    -------
    (B,) array of bool
    """
    _, sigma, rows = np.linalg.svd(structure)
    null = rows[:, -2:]
    angles = np.sort(np.arctan2(null[:, 1], null[:, 0]), axis=1)
    gaps = np.diff(angles, axis=1, append=angles[:, :1] + 2 * np.pi)
    return np.asarray((gaps.max(axis=1) > np.pi + 1e-9) & (sigma[:, -1] > 1e-8 * sigma[:, 0]))


def _row(
    name: str,
    W: Floats,
    limits: tuple[Floats, Floats],
    metric: Callable[[], Any],
    by_numpy: Callable[[], Any] | None,
    rounds: int,
) -> Row:
    """Time the metric and its baselines in turn, so that what else the machine does hits all alike."""
    from scipy.optimize import linprog

    count, n, m = W.shape
    cores = os.cpu_count() or 1
    zero, cost, feasible = np.zeros(n), np.zeros(m), highs.feasibility_checker()
    bounds = [(float(low), float(high)) for low, high in zip(*limits, strict=True)]
    times: dict[str, list[float]] = {"one": [], "all": [], "numpy": [], "highs": [], "linprog": []}

    def clock(key: str, poses: int, work: Callable[[], Any]) -> None:
        began = time.perf_counter()
        work()
        times[key].append((time.perf_counter() - began) / poses)

    def by_scipy(matrices: Floats) -> None:
        for matrix in matrices:
            linprog(cost, A_eq=matrix, b_eq=zero, bounds=bounds)

    for turn in range(rounds):
        for key, number in (("one", 1), ("all", cores)):
            with using_threads(number):
                clock(key, count, metric)
        if by_numpy is not None:
            clock("numpy", count, by_numpy)
        some = W[np.arange(turn * BASELINE_CALLS, (turn + 1) * BASELINE_CALLS) % count]
        few = some[: BASELINE_CALLS // 8]
        models = [highs.model(each, zero, *limits) for each in some]
        clock("highs", len(some), partial(feasible, models))
        clock("linprog", len(few), partial(by_scipy, few))
    best = {key: min(values, default=float("nan")) for key, values in times.items()}
    return Row(name, count, cores, best["one"], best["all"], best["numpy"], best["highs"], best["linprog"])


@dataclass(frozen=True)
class Verification:
    """Agreement of capacity margin and linear program.

    Attributes
    ----------
    name : str
    poses : int
    feasible : int
        Poses at which the linear program finds tensions.
    undecided : int
        Margins too close to zero to tell.
    contradicted : int
        Of the others, those whose sign the linear program contradicts.
    """

    name: str
    poses: int
    feasible: int
    undecided: int
    contradicted: int


def verify(n: int, m: int, count: int, seed: int = 0) -> Verification:
    """Compare the sign of the capacity margin about a random wrench with HiGHS, at random poses.

    Every cable has limits of its own. A point in a plane, n = 2, is a point in space without its third component.
    """
    rng = np.random.default_rng([seed, n, m])
    W = structures(rng, max(n, 3), m, count)[:, :n]
    lower = rng.uniform(0.0, 1.0, (count, m))
    upper = lower + rng.uniform(0.5, 6.0, (count, m))
    wrench = np.einsum("bnm,bm->bn", W, rng.uniform(lower, upper)) * rng.uniform(0.5, 3.0, (count, 1))
    margin = capacity_margin(W, (lower, upper), wrench[:, None])
    found = np.array(highs.feasibility_checker()(map(highs.model, W, wrench, lower, upper)))
    decided = np.abs(margin) > UNDECIDED_MARGIN_N
    wrong = decided & ((margin > 0) != found)
    return _verification(f"n = {n}, m = {m}", found, decided, wrong)


def verify_suspended(name: str, count: int, seed: int = 0) -> Verification:
    """Compare the metric "wrench-feasible" of a robot that holds its weight with `scipy.optimize.linprog`.

    At random poses below the anchors, turned by up to `TILT` about a random axis; the weight must be held while a
    force of `PUSH_SHARE` of it acts along any axis, either way: six programs a pose, until one has no solution.
    """
    from scipy.optimize import linprog

    rng, rig = np.random.default_rng([seed, 1]), load_rig(name)
    low, high = rig.anchors.min(axis=0), rig.anchors.max(axis=0)
    position = rng.uniform(low * [1.0, 1.0, 0.0], high, size=(count, 3))
    rotation = rotations(unit_vectors(rng, count, 3), rng.uniform(0.0, TILT, count))
    push = PUSH_SHARE * float(np.linalg.norm(rig.gravity()[:3])) * np.eye(6)[:3]
    required = Requirement(wrenches=np.concatenate([push, -push]), gravity=True)
    metrics = ["wrench-feasible", "capacity-margin"]
    swept = sweep(rig, PoseList(position, rotation), metrics, required=required)
    feasible, margin = (swept[each].to_numpy()[0] for each in metrics)
    wrenches = required.at(rig, rotation)
    bounds = [(float(low), float(high)) for low, high in zip(rig.limits.lower, rig.limits.upper, strict=True)]
    found = np.array([
        all(linprog(np.zeros(rig.m), A_eq=W, b_eq=wrench, bounds=bounds).success for wrench in corners)
        for W, corners in zip(rig.structure_matrix(position, rotation), wrenches, strict=True)
    ])  # fmt: skip
    decided = np.abs(margin) > feasibility_tolerance(wrenches)
    return _verification(f"{name}, {rig.required.describe(rig)}", found, decided, decided & (feasible != found))


def _verification(
    name: str, found: NDArray[np.bool_], decided: NDArray[np.bool_], wrong: NDArray[np.bool_]
) -> Verification:
    return Verification(name, len(found), *(int(np.count_nonzero(each)) for each in (found, ~decided, wrong)))


def main() -> None:
    """Print one of the two tables; exit status 1 if HiGHS contradicts a sign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--verify", action="store_true", help="compare signs instead of times")
    parser.add_argument("--count", type=int, default=100_000, help="poses of the verification")
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    if options.verify:
        print(f"{'':36}   poses feasible  undecided  contradicted")
        found = [verify(n, m, options.count // len(SHAPES)) for n, m in SHAPES]
        found += [verify_suspended(name, options.count // 10) for name in SUSPENDED]
        for each in found:
            counts = f"{each.poses:8,d} {each.feasible:8,d} {each.undecided:10,d} {each.contradicted:13,d}"
            print(f"{each.name:36}{counts}")
        raise SystemExit(any(each.contradicted for each in found))
    print(describe_kernels())
    print(
        "              µs a pose:            poses   1 core      all NumPy SVD    HiGHS  linprog  HiGHS / 1 core"
    )
    for row in (
        margin_row(3, 8, 20_000, options.rounds),
        margin_row(6, 8, 10_000, options.rounds),
        closure_row(0.1, options.rounds),
    ):
        times = (row.one_core_s, row.all_cores_s, row.numpy_s, row.highs_s, row.linprog_s)
        cells = " ".join(f"{1e6 * value:8.3f}" for value in times)
        print(f"{row.name:32} {row.poses:8,d} {cells} {row.highs_s / row.one_core_s:10.0f}")


if __name__ == "__main__":
    main()
