"""Parts that the program solvers share: bases that respect the rank, and the policies."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tensionlab.solvers.base import GRAZING, RANK_TOLERANCE, TOLERANCE, Answer, Problem
from tensionlab.support.arrays import Floats

SAFETY = 0.1  # share of `TOLERANCE` that an answer may use up before the next program is tried
NO_TENSIONS = "gave no tensions, not even inside the limits alone"
RAMP_SHARE = 0.1  # share of the tolerance that is not used at s = 0; all of it is at s = 1
INSIDE_SHARE = 1e-6  # a tension this far from its limits, as a share of the largest, is between them
MAX_CUTS = 12  # most nearest wrenches that are sought; three or four are usual


def times(matrices: Floats, vectors: Floats) -> Floats:
    """Multiply each matrix, (..., n, m), with its own vector, (..., m)."""
    product: Floats = np.matmul(matrices, vectors[..., None])[..., 0]
    return product


def independent_rows(matrix: Floats) -> tuple[Floats, Floats]:
    """Return the independent combinations of the rows of a matrix (n, m), and how strong each is.

    Orthonormal columns U, (n, r), such that the r rows of ``U' matrix`` are orthogonal and span its row space; and
    the norms of those rows, (r,): the singular values that count, largest first.
    """
    basis: Floats
    strength: Floats
    basis, strength, _ = np.linalg.svd(matrix, full_matrices=False)
    kept = strength > RANK_TOLERANCE * strength.max(initial=0.0)
    return basis[:, kept], strength[kept]


def whitener(structure: Floats) -> Floats:
    """Return ``((W W')⁺)^(1/2)``, (..., n, n), symmetric, of structure matrices W, (..., n, m).

    The norm of it times a wrench is the norm of the least tensions that render that wrench, so it is the metric of
    the "tension" policy.
    """
    basis, strength, _ = np.linalg.svd(structure, full_matrices=False)
    kept = strength > RANK_TOLERANCE * strength.max(axis=-1, keepdims=True, initial=0.0)
    inverse = np.divide(1.0, strength, where=kept, out=np.zeros_like(strength))
    root: Floats = (basis * inverse[..., None, :]) @ np.swapaxes(basis, -1, -2)
    return root


@dataclass(frozen=True)
class Ray:
    """Wrench w of one problem, in N, of which ``s w`` may be rendered for s in [0, 1].

    ``nearest`` takes s, and returns tensions inside the limits with the least ``|W t - s w|``, or None.
    """

    structure: Floats
    wrench: Floats
    lower: Floats
    upper: Floats
    nearest: Callable[[float], Floats | None]

    def relax_within_tolerance(self, tensions: Floats | None, scale: float) -> Floats | None:
        """Return tensions for more of the wrench where the tolerance allows more, or those given.

        ``tensions`` are those of the largest s with ``W t = s w``, None where there is no such s; ``scale`` is s.
        """
        length = float(np.linalg.norm(self.wrench))
        largest = np.maximum(np.abs(self.lower), np.abs(self.upper))
        tolerance = TOLERANCE * max(1.0, min(length, float((np.abs(self.structure) * largest).sum())))
        if tensions is not None and length > 0.0:
            line = self._line(min(1.0, scale + tolerance / (GRAZING * length)))
            if line is None:
                return tensions
            _, along, reach = line
            if along >= GRAZING * length and along - reach > tolerance:
                return tensions
        s = 1.0
        for _ in range(MAX_CUTS):
            line = self._line(s)
            if line is None:
                return tensions
            nearest, along, reach = line
            if s == 1.0 and along - reach <= tolerance:
                return nearest
            if s * (along - RAMP_SHARE * tolerance) <= reach + (1.0 - RAMP_SHARE) * tolerance:
                share = float(np.clip(2.0 - 2.0 * along / (GRAZING * length), 0.0, 1.0)) * tolerance
                if share == 0.0 and tensions is not None:
                    return tensions
                less = self._line(max(0.0, (reach + (1.0 - RAMP_SHARE) * share) / (along - RAMP_SHARE * share)))
                return nearest if less is None else less[0]
            if along <= RAMP_SHARE * tolerance or reach + (1.0 - RAMP_SHARE) * tolerance < 0.0:
                return tensions
            s = (reach + (1.0 - RAMP_SHARE) * tolerance) / (along - RAMP_SHARE * tolerance)
        return tensions

    def _polished(self, tensions: Floats, scale: float) -> Floats:
        """Let the cables between their limits render what they can of the error that the program has left."""
        play = INSIDE_SHARE * float(np.abs(self.upper).max())
        free = (tensions - self.lower > play) & (self.upper - tensions > play)
        error = scale * self.wrench - self.structure @ tensions
        better = tensions.copy()
        better[free] += np.linalg.pinv(self.structure[:, free], rcond=RANK_TOLERANCE) @ error
        return better if ((self.lower <= better) & (better <= self.upper)).all() else tensions

    def _line(self, scale: float) -> tuple[Floats, float, float] | None:
        """Return the tensions nearest to ``s w``, and of the unit error d there d'w and the most of ``d·W t``."""
        tensions = self.nearest(scale)
        if tensions is None:
            return None
        tensions = self._polished(tensions, scale)
        error = scale * self.wrench - self.structure @ tensions
        size = float(np.linalg.norm(error))
        unit = error / size if size > 0.0 else np.zeros_like(error)
        pull = unit @ self.structure
        reach = float(np.maximum(pull * self.lower, pull * self.upper).sum())
        return tensions, float(unit @ self.wrench), reach


@dataclass(frozen=True)
class ScaledProblem:
    """One problem with tensions in units of the largest limit or reference, without cables whose limits are equal.

    Those would leave an interior-point method no interior. They pull ``fixed_wrench``; the other ``cables`` render
    the difference to ``wrench``. An error up to ``accepted`` counts as none.
    """

    structure: Floats
    wrench: Floats
    fixed_wrench: Floats
    lower: Floats
    upper: Floats
    reference: Floats
    accepted: float
    unit: float
    cables: NDArray[np.bool_]


def _scale(problem: Problem, row: int) -> ScaledProblem | None:
    """Scale one problem of a batch; None if the cables whose limits differ pull nothing."""
    structure, wrench, lower, upper, reference = (array[row] for array in problem.arrays[:5])
    free = lower < upper
    if not structure[:, free].any():
        return None
    unit = float(max(abs(lower).max(), abs(upper).max(), abs(reference).max()))
    return ScaledProblem(
        structure=structure[:, free],
        wrench=wrench / unit,
        fixed_wrench=structure[:, ~free] @ lower[~free] / unit,
        lower=lower[free] / unit,
        upper=upper[free] / unit,
        reference=reference[free] / unit,
        accepted=SAFETY * TOLERANCE * max(1.0, float(np.linalg.norm(wrench))) / unit,
        unit=unit,
        cables=free,
    )


class Programs(Protocol):
    """Programs of one problem, as a backend solves them; None where it gives no tensions inside the limits."""

    scaled: ScaledProblem
    iterations: int  # spent so far
    reason: str  # why there are no tensions, where there are none

    def closest(self, wrench: Floats) -> Floats | None:
        """Return the tensions closest to the reference that render a wrench."""

    def least_error(self, root: Floats, wrench: Floats) -> Floats | None:
        """Return the tensions with the least ``|root (W t - wrench)|``."""

    def longest(self) -> tuple[Floats | None, float]:
        """Return the tensions that render ``s wrench - fixed_wrench``, s the largest in [0, 1], and s."""


def choose_each(
    problem: Problem, backend: str, start: Callable[[ScaledProblem], Programs], errors: tuple[type[Exception], ...]
) -> Answer:
    """Choose tensions for every problem of a batch, one after another.

    ``start`` returns the programs of a scaled problem. ``errors`` are what the backend raises on a program that it
    cannot solve. Problems whose cables can do nothing about the wrench are not given to the backend.
    """
    tensions = np.clip(problem.reference, problem.lower, problem.upper)
    iterations = np.zeros(len(problem), dtype=np.int64)
    failures: dict[int, str] = {}
    with warnings.catch_warnings():
        # Backends warn of programs without a solution and of inaccurate answers; all of them are measured.
        warnings.simplefilter("ignore")
        for row in range(len(problem)):
            scaled = _scale(problem, row)
            if scaled is None:
                continue
            programs, chosen, reason = start(scaled), None, ""
            try:
                chosen = _choose(programs, problem, row)
            except errors as error:
                reason = f"{type(error).__name__}: {error}"
            iterations[row] = programs.iterations
            if chosen is None:
                tensions[row] = np.nan
                failures[row] = f"{backend}: {reason or programs.reason}"
            else:
                limits = problem.lower[row, scaled.cables], problem.upper[row, scaled.cables]
                tensions[row, scaled.cables] = np.clip(chosen * scaled.unit, *limits)
    return Answer(tensions, iterations, failures=failures)


def _choose(programs: Programs, problem: Problem, row: int) -> Floats | None:
    """Return the tensions that the policy chooses for one problem of a batch; None if the backend gives none."""
    scaled = programs.scaled
    wrench = scaled.wrench - scaled.fixed_wrench
    exact = _closest(programs, wrench)
    if exact is not None:
        return exact
    best = _solve_direction_policy(programs) if problem.policy == "direction" else None
    if best is None:
        force = np.diag(np.sqrt(problem.weights))
        root = whitener(problem.structure[row]) if problem.policy == "tension" else force
        best = programs.least_error(root, wrench)
    if best is None:
        return None
    tied = _closest(programs, scaled.structure @ best)
    return best if tied is None else tied


def _closest(programs: Programs, wrench: Floats) -> Floats | None:
    """Return the tensions of the first program; None where they miss the wrench, whatever the backend says."""
    tensions, scaled = programs.closest(wrench), programs.scaled
    if tensions is None or np.linalg.norm(scaled.structure @ tensions - wrench) > scaled.accepted:
        return None
    return tensions


def _solve_direction_policy(programs: Programs) -> Floats | None:
    """Return tensions for the largest scale of the wrench, within tolerance of the edge of what is feasible."""
    scaled = programs.scaled
    best, scale = programs.longest()
    # Cables with equal limits are one cable with a tension of 1 here, and all is in newton again.
    identity = np.eye(len(scaled.wrench))

    def nearest(s: float) -> Floats | None:
        tensions = programs.least_error(identity, s * scaled.wrench - scaled.fixed_wrench)
        return None if tensions is None else np.append(tensions, 1.0)

    ray = Ray(
        np.column_stack([scaled.structure, scaled.fixed_wrench]) * scaled.unit,
        scaled.wrench * scaled.unit,
        np.append(scaled.lower, 1.0),
        np.append(scaled.upper, 1.0),
        nearest,
    )
    extended = ray.relax_within_tolerance(None if best is None else np.append(best, 1.0), scale)
    return None if extended is None else extended[:-1]


def finite_tensions(values: Any, cables: int) -> Floats | None:
    """Return what a backend gave as finite tensions, or None."""
    if values is None or np.shape(values) != (cables,) or not np.isfinite(values).all():
        return None
    return np.array(values, dtype=np.float64)
