"""Statement in NumPy of what `tensionlab._native.certify_cells` proves of one cell, without turns."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from tensionlab.support.arrays import Floats
from tensionlab.workspace.certification import CellProblem


class Pull(NamedTuple):
    """What each cable pulls along a direction: value (m), slope (m, d), curve (m, d, d), and the rest (m)."""

    value: Floats
    slope: Floats
    curve: Floats
    error: Floats


class Ray(NamedTuple):
    """Direction across some columns."""

    v: Floats
    across: list[int]
    sides: Floats


def scatter(number: int) -> float:
    """Return the number by which a column's entry is moved."""
    turn = 0.6180339887498949 * (number + 1) ** 2
    return turn - np.floor(turn) - 0.5


class Cell:
    """Columns of the structure matrix over a cell of positions, and the bounds that follow."""

    def __init__(self, problem: CellProblem, centre: Floats, half: Floats) -> None:
        self.problem, self.half = problem, half
        arms, torque = problem.arms[0], problem.arms[0] / problem.length
        m, d = arms.shape
        n = problem.wrenches.shape[2]
        q = problem.anchors[0] - arms - centre
        length = np.linalg.norm(q, axis=1)
        self.u = q / length[:, None]
        moved = np.linalg.norm(half)
        share = moved / (length - moved)
        self.change = 2 * np.sin(np.arcsin(moved / length) / 2)
        self.bent = share**2 / np.sqrt(3)
        affine = self.bent < self.change
        self.rest = np.where(affine, share**3 / 2, self.change)
        self.bent = np.where(affine, self.bent, self.change)
        self.inverse = affine / length
        self.across = np.eye(d) - self.u[:, :, None] * self.u[:, None, :]
        self.lever = np.zeros((m, d, n))  # v . w = (lever v) . u
        self.lever[:, :, :d] = np.eye(d)
        if n == 3 and d == 2:
            self.lever[:, :, 2] = np.stack([-torque[:, 1], torque[:, 0]], axis=1)
        elif n == 6:
            self.lever[:, :, 3:] = -np.cross(torque[:, None, :], np.eye(3)).swapaxes(1, 2)
        self.W = np.einsum("jdn,jd->nj", self.lever, self.u)

    def pull(self, v: Floats) -> Pull:
        """Return the second-order expansion of v . w."""
        a = self.lever @ v
        value = (a * self.u).sum(axis=1)
        slope = -np.einsum("jde,je->jd", self.across, a) * self.inverse[:, None]
        turned = slope[:, :, None] * self.u[:, None, :]
        curve = turned + turned.swapaxes(1, 2) - (value * self.inverse)[:, None, None] * self.across
        return Pull(value, slope, curve * self.inverse[:, None, None], np.linalg.norm(a, axis=1) * self.rest)

    def rays(self) -> Iterator[Ray]:
        """Yield a direction across each n - 1 of the columns, which are moved a little."""
        n, m = self.W.shape
        moves = np.array([[scatter(j * n + k) for j in range(m)] for k in range(n)])
        W = self.W + 2.0**-20 * np.linalg.norm(self.W, axis=0).max() * moves
        for across in combinations(range(m), n - 1):
            v = np.linalg.svd(W[:, across].T)[2][-1]
            yield Ray(v, list(across), np.sign(v @ W))

    def follow(self, v: Floats, across: list[int], pull: Pull) -> tuple[Floats, Pull]:
        """Return how v moves (d, n) to stay across its columns, and what that adds to the pull."""
        dual = np.linalg.pinv(self.W[:, across])
        mu = -pull.slope[across].T @ dual
        a = np.einsum("jdn,in->jid", self.lever, mu)
        both = -np.einsum("jde,jie->jid", self.across, a) * self.inverse[:, None, None]
        error = (np.linalg.norm(a, axis=2) @ self.half) * self.bent
        return mu, Pull(np.zeros(len(a)), (mu @ self.W).T, both + both.swapaxes(1, 2), error)

    def least(self, curve: Floats) -> Floats:
        """Return the least that x' C x / 2 may be, for each of some C."""
        h = self.half
        diagonal = np.einsum("...ii->...i", curve)
        off = np.abs(curve) * np.outer(h, h) * (1 - np.eye(len(h)))
        return (np.minimum(diagonal, 0) * h**2).sum(axis=-1) / 2 - off.sum(axis=(-2, -1)) / 2

    def reach(self, pull: Pull) -> Floats:
        """Return the most that each pull changes by, but for the error."""
        curve = -np.minimum(self.least(pull.curve), self.least(-pull.curve))
        return np.abs(pull.slope) @ self.half + curve

    def spare(self, ray: Ray, side: float, moved: bool) -> tuple[float, Floats]:
        """Return a lower bound, value and slope, of what the tensions around a ray have to spare on one side."""
        p, pull, mu = self.problem, self.pull(ray.v), np.zeros((len(self.half), len(ray.v)))
        if moved:
            mu, added = self.follow(ray.v, ray.across, pull)
            pull = Pull(*(a + b for a, b in zip(pull, added, strict=True)))
        tension = np.where(ray.sides * side > 0, p.upper, p.lower)
        lost = tension @ pull.error
        for j in ray.across:
            lost += (p.upper[j] - p.lower[j]) / 2 * (abs(pull.value[j]) + self.reach(pull)[j])
            lost += (p.upper[j] - tension[j]) * pull.error[j]
        tension[ray.across] = ((p.upper + p.lower) / 2)[ray.across]
        value, slope = side * tension @ pull.value - lost, side * tension @ pull.slope
        value += self.least(side * np.tensordot(tension, pull.curve, 1))
        if not p.closure:
            along = side * p.wrenches[0] @ ray.v
            chosen = p.wrenches[0][along.argmax()]
            longest = np.linalg.norm(mu, axis=1) @ self.half
            more = along - along.max() + np.abs((p.wrenches[0] - chosen) @ mu.T) @ self.half
            value -= along.max() + max(0.0, more.max()) + p.radius * (1 + longest**2 / 2)
            slope = slope - side * mu @ chosen - p.radius * mu @ ray.v
        return float(value), slope

    def inside(self) -> float:
        """Return what is to spare everywhere in the cell, at least: above zero if all of it is inside."""
        worst = np.inf
        for ray in self.rays():
            for moved in (False, True):
                least = min(
                    value - np.abs(slope) @ self.half
                    for value, slope in (self.spare(ray, side, moved) for side in (1.0, -1.0))
                )
                if least > 0:
                    break
            worst = min(worst, least)
        return worst

    def outside(self) -> float:
        """Return what is missing along the worst ray everywhere in the cell, at least: above zero if outside."""
        p = self.problem

        def room(v: Floats) -> float:
            x = v @ self.W
            return float(np.maximum(p.lower * x, p.upper * x).sum() - (p.wrenches[0] @ v).max() - p.radius)

        ray = min(
            (ray._replace(v=side * ray.v) for ray in self.rays() for side in (1, -1)), key=lambda r: room(r.v)
        )
        mu, added = self.follow(ray.v, ray.across, self.pull(ray.v))
        pull = Pull(*(a + b for a, b in zip(self.pull(ray.v), added, strict=True)))
        x = pull.value
        tension = np.where(x > 0, p.upper, p.lower)
        crossing = np.maximum(0.0, self.reach(pull) + pull.error - np.abs(x))
        chosen = p.wrenches[0][(p.wrenches[0] @ ray.v).argmax()]
        value = tension @ (x + pull.error) + (p.upper - p.lower) @ crossing - ray.v @ chosen - p.radius
        slope = tension @ pull.slope - mu @ chosen - p.radius * mu @ ray.v
        value -= self.least(-np.tensordot(tension, pull.curve, 1))
        return float(-value - np.abs(slope) @ self.half)
