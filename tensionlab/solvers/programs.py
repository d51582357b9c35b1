"""Parts that the program solvers share: bases that respect the rank, and the direction policy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.solvers.base import GRAZING, RANK_TOLERANCE, TOLERANCE, Problem


def times(matrices: Floats, vectors: Floats) -> Floats:
    """Multiply each matrix, (..., n, m), with its own vector, (..., m)."""
    product: Floats = np.matmul(matrices, vectors[..., None])[..., 0]
    return product


def independent_rows(matrix: Floats) -> tuple[Floats, Floats]:
    """Return the independent combinations of the rows of a matrix, and how strong each is.

    Parameters
    ----------
    matrix : (n, m) array

    Returns
    -------
    basis : (n, r) array
        Orthonormal columns U such that the r rows of ``U' matrix`` are orthogonal and span its row space.
    strength : (r,) array
        Norms of those rows: the singular values that count, largest first.
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


SAFETY = 0.1
"""Share of `TOLERANCE` that an answer of `choose` may use up before the next program is tried."""
NO_TENSIONS = "gave no tensions, not even inside the limits alone"
RAMP_SHARE = 0.1
"""Share of the tolerance that is not used at s = 0; all of it is at s = 1."""
INSIDE_SHARE = 1e-6
"""A tension this far from its limits, as a share of the largest, is between them."""
MAX_CUTS = 12
"""Most nearest wrenches that are sought; three or four are usual."""


@dataclass(frozen=True)
class Ray:
    """Wrench w and what may be rendered of it: ``s w`` for s in [0, 1].

    Attributes
    ----------
    structure, wrench, lower, upper : arrays
        Of one problem, (n, m), (n,), (m,) and (m,), in N.
    nearest : callable
        Takes s, and returns tensions inside the limits with the least ``|W t - s w|``, or None.
    """

    structure: Floats
    wrench: Floats
    lower: Floats
    upper: Floats
    nearest: Callable[[float], Floats | None]

    def widened(self, tensions: Floats | None, scale: float) -> Floats | None:
        """Return tensions for more of the wrench where the tolerance allows more, or those given.

        Parameters
        ----------
        tensions : (m,) array or None
            For the largest s with ``W t = s w``, or None where there is no such s.
        scale : float
            That s.
        """
        length = float(np.linalg.norm(self.wrench))
        largest = np.maximum(np.abs(self.lower), np.abs(self.upper))
        tolerance = TOLERANCE * max(1.0, min(length, float((np.abs(self.structure) * largest).sum())))
        if tensions is not None and length > 0.0:
            found = self._line(min(1.0, scale + tolerance / (GRAZING * length)))
            if found is None:
                return tensions
            _, along, reach = found
            if along >= GRAZING * length and along - reach > tolerance:
                return tensions
        s = 1.0
        for _ in range(MAX_CUTS):
            found = self._line(s)
            if found is None:
                return tensions
            nearest, along, reach = found
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
    """One problem with tensions in units of the largest limit or reference, its fixed cables in ``held``.

    The other cables must render ``wrench - held``; an error of ``accepted`` is as good as none.
    """

    structure: Floats
    wrench: Floats
    held: Floats
    lower: Floats
    upper: Floats
    reference: Floats
    accepted: float
    unit: float


class Programs(Protocol):
    """Programs of one problem, as a backend solves them; None where it gives no tensions inside the limits."""

    @property
    def scaled(self) -> ScaledProblem:
        """The problem."""
        ...

    def closest(self, wrench: Floats) -> Floats | None:
        """Return the tensions closest to the reference that render a wrench."""
        ...

    def least_error(self, root: Floats, wrench: Floats) -> Floats | None:
        """Return the tensions with the least ``|root (W t + held - wrench)|``."""
        ...

    def longest(self) -> tuple[Floats | None, float]:
        """Return the tensions that render ``s wrench`` with the largest s in [0, 1], and that s."""
        ...


def choose(programs: Programs, problem: Problem, row: int) -> Floats | None:
    """Return the tensions that the policy chooses for one problem of a batch; None if the backend gives none."""
    scaled = programs.scaled
    found = _closest(programs, scaled.wrench)
    if found is not None:
        return found
    best = _along(programs) if problem.nearest == "direction" else None
    if best is None:
        force = np.diag(np.sqrt(problem.weights))
        root = whitener(problem.structure[row]) if problem.nearest == "tension" else force
        best = programs.least_error(root, scaled.wrench)
    if best is None:
        return None
    tied = _closest(programs, scaled.structure @ best + scaled.held)
    return best if tied is None else tied


def _closest(programs: Programs, wrench: Floats) -> Floats | None:
    """Return the tensions of the first program; None where they miss the wrench, whatever the backend says."""
    found, scaled = programs.closest(wrench), programs.scaled
    if found is None or np.linalg.norm(scaled.structure @ found + scaled.held - wrench) > scaled.accepted:
        return None
    return found


def _along(programs: Programs) -> Floats | None:
    """Return tensions for the most of the wrench, within tolerance where it grazes what can be rendered."""
    scaled = programs.scaled
    best, scale = programs.longest()
    # The cables that are held are one more, with a tension of 1, and all is in newton again.
    identity = np.eye(len(scaled.wrench))

    def nearest(s: float) -> Floats | None:
        tensions = programs.least_error(identity, s * scaled.wrench)
        return None if tensions is None else np.append(tensions, 1.0)

    ray = Ray(
        np.column_stack([scaled.structure, scaled.held]) * scaled.unit,
        scaled.wrench * scaled.unit,
        np.append(scaled.lower, 1.0),
        np.append(scaled.upper, 1.0),
        nearest,
    )
    found = ray.widened(None if best is None else np.append(best, 1.0), scale)
    return None if found is None else found[:-1]
