"""Problems for the tests: seeded random ones, and the awkward ones that hypothesis draws."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

import tensionlab as tl
from tensionlab.support.arrays import Floats


@dataclass(frozen=True)
class Case:
    """One problem, or a batch of them with a leading axis on all but ``weights``."""

    structure: Floats
    wrench: Floats
    lower: Floats
    upper: Floats
    reference: Floats
    weights: Floats

    @property
    def limits(self) -> tuple[Floats, Floats]:
        return self.lower, self.upper


def stack(cases: list[Case]) -> Case:
    """One batch of problems of one shape; the weights are those of the first."""
    first, *_ = cases
    fields = ("structure", "wrench", "lower", "upper", "reference")
    return Case(**{f: np.stack([getattr(c, f) for c in cases]) for f in fields}, weights=first.weights)


def one(case: Case, i: int) -> Case:
    """Problem i of a batch."""
    return Case(case.structure[i], case.wrench[i], case.lower[i], case.upper[i], case.reference[i], case.weights)


def random_structure(rng: np.random.Generator, n: int, m: int) -> Floats:
    """Structure matrix of a point (n = 2, 3) or of a platform of about 0.3 m (n = 6)."""
    u = rng.normal(size=(min(n, 3), m))
    u /= np.linalg.norm(u, axis=0)
    if n < 6:
        return u
    return np.vstack([u, np.cross(rng.uniform(-0.3, 0.3, size=(m, 3)), u.T).T])


def edge_of_workspace(seed: int, n: int, m: int, count: int, limits: tuple[float, float]) -> tuple[Floats, ...]:
    """Structure matrices, wrenches on facets of the available wrench set, and the facets' normals.

    There n - 1 cables pull anyhow, and all others are at the limit that pulls outwards.
    """
    rng = np.random.default_rng(seed)
    W = np.stack([random_structure(rng, n, m) for _ in range(count)])
    normal = np.linalg.svd(np.swapaxes(W[:, :, : n - 1], 1, 2))[2][:, -1]
    tensions = np.where(np.einsum("bn,bnm->bm", normal, W) > 0, limits[1], limits[0])
    tensions[:, : n - 1] = rng.uniform(1.5, 5.0, (count, n - 1))
    return W, np.einsum("bnm,bm->bn", W, tensions), normal


def exact_tensions(W: Any, w: Any, limits: Any, solver: str, reference: Any = None) -> Floats:
    """Tensions of problems, all of which a solver must answer exactly."""
    found = tl.allocate(W, w, limits, solver, reference)
    assert np.all(found.status == tl.Status.EXACT)
    return found.tensions


def random_case(rng: np.random.Generator, n: int, m: int) -> Case:
    """A problem with its own limits for each cable; about half of them can be rendered."""
    W = random_structure(rng, n, m)
    lower = rng.uniform(0.0, 1.0, m) * (rng.random() < 0.8)
    upper = lower + rng.uniform(0.5, 6.0, m)
    inside = W @ rng.uniform(lower, upper)
    kind = rng.integers(4)
    if kind < 2:
        wrench = inside
    elif kind == 2:  # a little to far beyond
        wrench = inside * rng.uniform(1.0, 4.0)
    else:
        wrench = rng.normal(size=n) * (np.ones(n) if n < 6 else np.repeat([1.0, 0.2], 3)) * rng.uniform(0.5, 8.0)
    references = (np.zeros(m), lower, (lower + upper) / 2, rng.uniform(-2.0, 8.0, m))
    weights = np.ones(n) if rng.random() < 0.6 else rng.uniform(0.2, 5.0, n)
    return Case(W, wrench, lower, upper, references[rng.integers(4)], weights)


def random_cases(seed: int, n: int, m: int, count: int) -> Case:
    """A batch of random problems that share their weights."""
    rng = np.random.default_rng(seed)
    return stack([random_case(rng, n, m) for _ in range(count)])


# --- Drawn by hypothesis ------------------------------------------------------------------------------------


def _grid_structure(draw: Any, n: int, m: int) -> Floats:
    """Small integers: parallel, duplicate, opposite and absent cables, singular and zero matrices."""
    entries = draw(st.lists(st.integers(-2, 2), min_size=n * m, max_size=n * m))
    return np.array(entries, dtype=float).reshape(n, m) / 2


def _bent_structure(draw: Any, rng: np.random.Generator, n: int, m: int) -> Floats:
    """A random matrix, spoilt: a repeated or parallel column, or rows nearly dependent."""
    W = random_structure(rng, n, m)
    kind = draw(st.sampled_from(["plain", "duplicate", "parallel", "nearly singular", "singular"]))
    if kind == "duplicate":
        W[:, -1] = W[:, 0]
    elif kind == "parallel":
        W[:, -1] = -2.0 * W[:, 0]
    elif kind == "nearly singular":
        W[-1] = W[0] + 10.0 ** draw(st.integers(-6, -1)) * W[-1]
    elif kind == "singular":
        W[-1] = W[0]
    return W


@st.composite
def cases(draw: Any, n: int | None = None, m: int | None = None, largest: int = 12) -> Case:
    """Draw one problem: any rank, any share of cables without room to move, in reach or not."""
    n = draw(st.sampled_from([2, 3, 6])) if n is None else n
    m = draw(st.integers(1, largest)) if m is None else m
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    W = _grid_structure(draw, n, m) if draw(st.booleans()) else _bent_structure(draw, rng, n, m)
    lower = np.array(draw(st.lists(st.sampled_from([0.0, 0.5, 1.0]), min_size=m, max_size=m)))
    room = np.array(draw(st.lists(st.sampled_from([0.0, 1.0, 5.5]), min_size=m, max_size=m)))
    upper = lower + room
    kind = draw(st.sampled_from(["zero", "inside", "outside", "any"]))
    wrench = {
        "zero": np.zeros(n),
        "inside": W @ rng.uniform(lower, upper),
        "outside": 3.0 * W @ rng.uniform(lower, upper),
        "any": np.round(4.0 * rng.normal(size=n), 1),
    }[kind]
    reference = draw(st.sampled_from(["zero", "lower", "middle", "random"]))
    start = {
        "zero": np.zeros(m),
        "lower": lower,
        "middle": (lower + upper) / 2,
        "random": np.round(rng.uniform(-2.0, 8.0, m), 1),
    }[reference]
    weights = np.ones(n) if draw(st.booleans()) else np.round(rng.uniform(0.2, 5.0, n), 2)
    return Case(W, wrench, lower, upper, start, weights)


@st.composite
def batches(draw: Any, largest: int = 4) -> Case:
    """Draw a batch of problems of one shape, with one set of weights."""
    n, m = draw(st.sampled_from([2, 3, 6])), draw(st.integers(1, 12))
    drawn = draw(st.lists(cases(n, m), min_size=1, max_size=largest))
    return stack([replace(c, weights=drawn[0].weights) for c in drawn])
