"""The compiled exact solver against a short statement of the same mathematics, and against itself."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.rigs import near_singular
from tests.helpers.examples import many

LOWER, UPPER = 0.5, 6.0


def random_problems(rng, count, n, m, stretch):
    """Structure matrices of unit cables (n = 6: with torques), and reachable wrenches times stretch."""
    u = rng.normal(size=(count, min(n, 3), m))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    arms = rng.normal(scale=0.3, size=(count, 3, m))
    structure = np.concatenate([u, np.cross(arms, u, axis=1)], axis=1) if n == 6 else u
    tensions = rng.uniform(LOWER, UPPER, size=(count, m))
    return structure, stretch * np.einsum("bnm,bm->bn", structure, tensions)


def dual_newton(structure, wrench, reference, eps=1e-6, rounds=6):
    """The method in NumPy: maximise the dual by proximal Newton steps, halving a step until the dual grows.

    g(y) = w·y - sum_i max over t_i in the limits of (W_i·y t_i - (t_i - t0_i)²/2), with gradient w - W t(y).
    """
    y = centre = np.zeros(len(wrench))

    def tensions(y):
        return np.clip(reference + structure.T @ y, LOWER, UPPER)

    def dual(y):
        t = tensions(y)
        return (
            wrench @ y
            - structure.T @ y @ t
            + (t - reference) @ (t - reference) / 2
            - eps / 2 * ((y - centre) @ (y - centre))
        )

    for _ in range(rounds):
        for _ in range(50):
            t = tensions(y)
            gradient = wrench - structure @ t - eps * (y - centre)
            free = (reference + structure.T @ y > LOWER) & (reference + structure.T @ y < UPPER)
            hessian = structure[:, free] @ structure[:, free].T + eps * np.eye(len(wrench))
            step = np.linalg.solve(hessian, gradient)
            size = 1.0
            while dual(y + size * step) < dual(y) + 1e-4 * size * gradient @ step and size > 1e-9:
                size /= 2
            y = y + size * step
            if np.abs(gradient).max() < 1e-10:
                break
        centre = y
    return tensions(y)


@pytest.mark.parametrize("n", [2, 3, 6])
@pytest.mark.parametrize("stretch", [1.0, 1.5])
def test_agrees_with_its_statement_in_numpy(n, stretch):
    rng = np.random.default_rng(n)
    structure, wrench = random_problems(rng, 12, n, 7, stretch)
    reference = rng.uniform(0, 3, size=(12, 7))
    result = tl.allocate(structure, wrench, (LOWER, UPPER), reference=reference, policy="force")
    for row in range(12):
        stated = dual_newton(structure[row], wrench[row], reference[row])
        np.testing.assert_allclose(structure[row] @ stated, result.wrench[row], atol=1e-7)
        if result.status[row] == tl.Status.EXACT:
            np.testing.assert_allclose(stated, result.tensions[row], atol=1e-7)


@pytest.mark.parametrize("policy", ["force", "tension", "direction"])
@pytest.mark.parametrize("cables", [1, 3, 6, 8, 32])
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_proves_every_answer(n, cables, policy):
    rng = np.random.default_rng(10 * n + cables)
    count = many(4000)
    for stretch in (1.0, 1.1, 3.0):
        structure, wrench = random_problems(rng, count, n, cables, stretch)
        if n == 1:
            structure, wrench = structure[:, :1], wrench[:, :1]
        result = tl.allocate(structure, wrench, (LOWER, UPPER), policy=policy)
        counts = result.counts()
        assert counts[tl.Status.EXACT] + counts[tl.Status.NEAREST] == count
        if stretch == 1.0:
            assert counts[tl.Status.EXACT] == count


def test_the_first_solve_loads_nothing():
    script = (
        "import sys, tensionlab as tl; tl.allocate; before = set(sys.modules); "
        "tl.allocate([[1.0, -1.0]], [1.0], (0.5, 6.0)); print(sorted(set(sys.modules) - before))"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == "[]"


def test_numbers_that_are_not_finite_are_left_to_the_caller():
    one = np.ones((1, 2))
    problem = tl.solvers.Problem(one[:, None], one[:, :1], 0.0 * one, one, 0.0 * one, np.ones(1), "force")
    np.testing.assert_allclose(tl.solvers.Newton().solve_verified(problem).tensions, [[0.5, 0.5]])
    assert tl.solvers.Newton().solve_verified(replace(problem, wrench=np.full((1, 1), np.nan))) is None


@pytest.mark.parametrize("policy", ["force", "direction"])
@pytest.mark.parametrize("condition", [1e2, 1e4, 1e6, 1e7])
@pytest.mark.parametrize(("n", "m"), [(3, 4), (3, 6), (6, 8)])
def test_the_tensions_of_a_nearly_singular_rig_are_as_good_as_rounding(n, m, condition, policy):
    # What is missing of the wrench moves the tensions by up to the condition times as much.
    rng = np.random.default_rng(1)
    structure = near_singular(rng, n, m, np.full(2000, condition))
    wrench = np.einsum("bnm,bm->bn", structure, rng.uniform(LOWER, UPPER, (2000, m)))
    found = tl.allocate(structure, wrench, (LOWER, UPPER), policy=policy)
    assert found.counts()[tl.Status.EXACT] == 2000
    free = (found.tensions > LOWER + 1e-9) & (found.tensions < UPPER - 1e-9)
    inverse = np.linalg.pinv(structure * free[:, None, :], rcond=1e-12)
    missing = np.einsum("bmn,bn->bm", inverse, wrench - found.wrench)
    assert np.linalg.norm(missing, axis=1).max() < 1e-11  # N
