"""Benchmark of brakes: the force that they add, and the time to choose them.

``python -m benchmarks.brakes`` (or ``make bench-brakes``): the mean force that stays unresisted
when a user pushes against a wall, over all directions of the wall, and the time of one decision for eight modules.
"""

from __future__ import annotations

import time

import numpy as np

from tensionlab.haptics.rendering.brakes import brake_map, choose_locks
from tensionlab.model.directions import fibonacci
from tensionlab.model.files import load_rig
from tensionlab.model.module import TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

BRAKE = 186.0  # what a brake holds, in N: the published one


def unresisted(rig: Rig, force: float, count: int = 10_000) -> list[float]:
    """Return the mean unresisted forces, in N, of the motors alone, of the best single brake, and of all.

    And which share of the walls is held by all, and met within 45 degrees.
    """
    U, normals = rig.structure_matrix(rig.home), fibonacci(count)
    motors = brake_map(U, normals, force, rig.limits, np.zeros(rig.m))
    single = force * np.sqrt(1.0 - np.square((normals @ U).max(axis=1).clip(0.0, 1.0)))
    both = brake_map(U, normals, force, rig.limits, np.full(rig.m, BRAKE))
    means = [motors.chosen.unresisted.mean(), single.mean(), both.chosen.unresisted.mean()]
    return [float(each) for each in (*means, (both.chosen.unresisted < 1e-6 * force).mean(), both.share())]


def random_walls(rng: np.random.Generator, m: int, count: int) -> tuple[Floats, Floats]:
    """Draw structure matrices of points and unit normals."""
    U, n = rng.normal(size=(count, 3, m)), rng.normal(size=(count, 3))
    return U / np.linalg.norm(U, axis=1, keepdims=True), n / np.linalg.norm(n, axis=1, keepdims=True)


def decision_times(m: int, outward: bool, count: int = 20_000) -> Floats:
    """How long does each of many decisions take, in s? ``outward``: with all brakes able to hold the wall."""
    U, n = random_walls(np.random.default_rng(m), m, count)
    if outward:
        U = U * np.sign(np.einsum("bim,bi->bm", U, n))[:, None]
    limits, strengths = TensionLimits(np.full(m, 0.5), np.full(m, 6.0)), np.full(m, BRAKE)
    times = np.empty(count)
    for index in range(count):
        begin = time.perf_counter()
        choose_locks(U[index], n[index], 50.0, limits, strengths)
        times[index] = time.perf_counter() - begin
    return times


def main() -> None:
    """Print the figures."""
    print("mean unresisted force: motors alone, best single brake alone, lock set and motors")
    for name in ("bartels2026-validation", "cube-8"):
        rig = load_rig(name)
        for force in (10.0, 50.0):
            motors, single, both, held, near = unresisted(rig, force)
            print(
                f"{name}, {force:.0f} N: {motors:.2f}, {single:.2f}, {both:.2f} N; {100 * held:.0f} % of the "
                f"walls held in full, {100 * near:.0f} % met within 45 degrees"
            )
    U, n = random_walls(np.random.default_rng(0), 8, 10_000)
    limits = TensionLimits(np.full(8, 0.5), np.full(8, 6.0))
    begin = time.perf_counter()
    chosen = choose_locks(U, n, 50.0, limits, np.full(8, BRAKE))
    took = time.perf_counter() - begin
    opposed = np.einsum("bim,bi->bm", U, n) < 0.0  # cables that would pay out as the hand leaves the wall
    blocked = int((chosen.locked & opposed).any(axis=1).sum())
    print(
        f"10000 random rigs of 8: {blocked} lock sets block withdrawal; {1e6 * took / len(U):.1f} us each at once"
    )
    for outward in (False, True):
        median, late = 1e6 * np.percentile(decision_times(8, outward), [50, 99])
        what = "all brakes able to hold" if outward else "random walls"
        print(f"one decision, 8 modules, {what}: {median:.0f} us median, {late:.0f} us p99")


if __name__ == "__main__":
    main()
