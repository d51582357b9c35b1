"""Numbers that are known beforehand: published cases, worked examples, the published rig."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import tensionlab as tl
from tensionlab.solvers import Policy, make

ROOT = Path(__file__).parents[1]
CASES = json.loads((ROOT / "tests/data/known_answers.json").read_text())["cases"]
SOLVERS = ("newton", "dykstra", "qp", "cvxpy")
REFERENCES = {"min2_from_zero": None, "min2_from_fmin": "lower", "min2_from_mid": "middle"}
TIGHT = tl.solvers.Dykstra(tolerance=1e-11)

FORCE = 1.5  # published magnitude of the 182 vectors, N


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("key", REFERENCES)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_least_norm(case: dict[str, Any], key: str, solver: str) -> None:
    limits = (case["fmin"], case["fmax"])
    chosen = TIGHT if solver == "dykstra" else solver
    found = tl.allocate(case["W"], case["wrench_to_produce"], limits, chosen, reference=REFERENCES[key])
    assert found.status == tl.Status.EXACT
    np.testing.assert_allclose(found.tensions, case[key], rtol=0, atol=1e-6)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_closed_form_from_the_middle(case: dict[str, Any]) -> None:
    # In all published cases the closed form stays inside the limits, where both variants are the same.
    for solver in ("pseudoinverse:middle", "closed-form"):
        found = tl.allocate(case["W"], case["wrench_to_produce"], (case["fmin"], case["fmax"]), solver)
        assert found.status == tl.Status.EXACT
        np.testing.assert_allclose(found.tensions, case["closed_form_mid"], rtol=0, atol=1e-6)


def angle(wanted: NDArray[np.float64], rendered: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angle between wrenches, in degrees; by the half-angle form, which is exact for small ones."""
    u = wanted / np.linalg.norm(wanted, axis=-1, keepdims=True)
    v = rendered / np.linalg.norm(rendered, axis=-1, keepdims=True)
    half = np.arctan2(np.linalg.norm(u - v, axis=-1), np.linalg.norm(u + v, axis=-1))
    return np.asarray(np.degrees(2 * half))


PROMISES = [(name, policy) for name in SOLVERS for policy in make(name).policies]
THREE_WAYS = {
    "tension": ((10, 575 / 122, 1), 2.24, np.nan),
    "force": ((10, 3.88, 1), 8.52, np.nan),
    "direction": ((10, 5, 1), 0.0, 8 / 15),
}


@pytest.mark.parametrize(("solver", "policy"), PROMISES)
def test_three_ways_to_be_nearest(solver: str, policy: Policy) -> None:
    tensions, degrees, scale = THREE_WAYS[policy]
    W, w = np.array([[1, -0.6, -0.6], [0, 0.8, -0.8]]), np.array([12.0, 6.0])
    found = tl.allocate(W, w, ([1] * 3, [10] * 3), solver, policy=policy)
    assert found.status == tl.Status.NEAREST
    np.testing.assert_allclose(found.tensions, tensions, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.scale, scale, rtol=0, atol=1e-7)
    assert angle(w, found.wrench) == pytest.approx(degrees, abs=0.005)
    d = found.separation
    assert d @ w > np.maximum(d @ W * 1, d @ W * 10).sum()


@pytest.fixture(scope="module")
def vectors() -> NDArray[np.float64]:
    """182 forces: an 18-degree grid, 9 rings of 20 and two poles on the vertical axis, Y."""
    polar, around = np.meshgrid(np.radians(18 * np.arange(1, 10)), np.radians(18 * np.arange(20)))
    rings = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=-1)
    return FORCE * np.concatenate([rings.reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]])


def published(name: str) -> tuple[tl.Rig, NDArray[np.float64]]:
    rig = tl.load_rig(ROOT / "datasets/rigs" / f"{name}.toml")
    return rig, rig.structure_matrix([0, 0.3, 0])


@pytest.mark.parametrize("solver", SOLVERS)
def test_published_rig_renders_all_vectors(solver: str, vectors: NDArray[np.float64]) -> None:
    rig, structure = published("bartels2026-validation")
    found = tl.allocate(structure, vectors, rig.limits, solver)
    assert vectors.shape == (182, 3)
    assert np.all(found.status == tl.Status.EXACT)
    exact = tl.allocate(structure, vectors, rig.limits)
    np.testing.assert_allclose(found.tensions, exact.tensions, rtol=0, atol=1e-5)


SMALL_RIG = {"tension": (10.7, 0.32), "force": (1.6, 0.20), "direction": (0, 0.20)}


@pytest.mark.parametrize(("solver", "policy"), PROMISES)
def test_small_rig_proves_29_out_of_reach(solver: str, policy: Policy, vectors: NDArray[np.float64]) -> None:
    degrees, residual = SMALL_RIG[policy]
    rig, structure = published("bartels2026-validation-0.3m")
    found = tl.allocate(structure, vectors, rig.limits, solver, policy=policy)
    assert np.count_nonzero(found.status == tl.Status.EXACT) == 153
    far = found.status == tl.Status.NEAREST
    assert np.count_nonzero(far) == 29
    d, gain = found.separation[far], found.separation[far] @ structure
    reach = np.maximum(gain * rig.limits.lower, gain * rig.limits.upper).sum(axis=1)
    assert np.all(np.sum(d * vectors[far], axis=1) > reach)
    assert angle(vectors, found.wrench).max() == pytest.approx(degrees, abs=0.05 if degrees else 1e-4)
    assert found.residual.max() == pytest.approx(residual, abs=0.005)


def test_three_floor_modules_alone_reach_22(vectors: NDArray[np.float64]) -> None:
    rig, structure = published("floor-3")
    found = tl.allocate(structure, vectors, rig.limits)
    assert np.count_nonzero(found.status == tl.Status.EXACT) == 22
    assert np.count_nonzero(found.status == tl.Status.NEAREST) == 160
    assert angle(vectors, found.wrench).mean() > 70
