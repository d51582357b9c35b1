"""Parts that the program solvers share: bases that respect the rank, and the direction policy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.solvers.base import GRAZING, RANK_TOLERANCE, TOLERANCE


def times(matrices: Floats, vectors: Floats) -> Floats:
    """Which vector each matrix makes of its own: (..., n, m) times (..., m) is (..., n)."""
    product: Floats = np.matmul(matrices, vectors[..., None])[..., 0]
    return product


def independent_rows(matrix: Floats) -> tuple[Floats, Floats]:
    """Which combinations of the rows of a matrix are independent, and how strong is each.

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
    """Which matrix turns the distance between wrenches into the distance between tensions.

    Parameters
    ----------
    structure : (..., n, m) array
        Structure matrices W.

    Returns
    -------
    (..., n, n) array
        ``((W W')⁺)^(1/2)``, symmetric. The norm of it times a wrench is the norm of the least tensions that
        render that wrench, so it is the metric of the "tension" policy.
    """
    basis, strength, _ = np.linalg.svd(structure, full_matrices=False)
    kept = strength > RANK_TOLERANCE * strength.max(axis=-1, keepdims=True, initial=0.0)
    inverse = np.divide(1.0, strength, where=kept, out=np.zeros_like(strength))
    root: Floats = (basis * inverse[..., None, :]) @ np.swapaxes(basis, -1, -2)
    return root


RAMP = 0.1
"""Share of the tolerance that is not used at s = 0; all of it is at s = 1."""
INSIDE = 1e-6
"""A tension this far from its limits, as a share of the largest, is between them."""
CUTS = 12
"""Most nearest wrenches that are sought; three or four are usual."""


@dataclass(frozen=True)
class Ray:
    """One wrench w and what may be rendered of it: ``s w`` for s in [0, 1].

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
        for _ in range(CUTS):
            found = self._line(s)
            if found is None:
                return tensions
            nearest, along, reach = found
            if s == 1.0 and along - reach <= tolerance:
                return nearest
            if s * (along - RAMP * tolerance) <= reach + (1.0 - RAMP) * tolerance:
                share = float(np.clip(2.0 - 2.0 * along / (GRAZING * length), 0.0, 1.0)) * tolerance
                if share == 0.0 and tensions is not None:
                    return tensions
                less = self._line(max(0.0, (reach + (1.0 - RAMP) * share) / (along - RAMP * share)))
                return nearest if less is None else less[0]
            if along <= RAMP * tolerance or reach + (1.0 - RAMP) * tolerance < 0.0:
                return tensions
            s = (reach + (1.0 - RAMP) * tolerance) / (along - RAMP * tolerance)
        return tensions

    def _polished(self, tensions: Floats, scale: float) -> Floats:
        """Let the cables between their limits render what they can of the error that the program has left."""
        play = INSIDE * float(np.abs(self.upper).max())
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
