"""What a good layout is: `Objective`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import ShapeError

LEAD = 0.1
"""What the force that is missing, or to spare, counts beside the share: enough to lead a search among equals."""


@dataclass(frozen=True)
class Objective:
    """What should a layout be best at?

    Attributes
    ----------
    force : float or None
        In N: the share of the target in which every force of this size can be rendered. None: the largest force
        that can be rendered in every direction everywhere in the target.

    Raises
    ------
    ShapeError
        If the force is not a positive number.
    """

    force: float | None = None

    def __post_init__(self) -> None:
        if self.force is not None and not (np.isfinite(self.force) and self.force > 0):
            raise ShapeError(f"objective: force is {self.force}; give a force in N above zero, or None")

    def score(self, margins: Floats) -> Floats:
        """How good are layouts, given the capacity margin at each point of the target?

        Parameters
        ----------
        margins : (..., P) array
            In N.

        Returns
        -------
        (...) array
            The worst margin in N, or the share of the points where it is at least the force.
        """
        if self.force is None:
            return np.asarray(margins.min(axis=-1))
        return np.asarray((margins >= self.force).mean(axis=-1))

    def merit(self, margins: Floats) -> Floats:
        """Which of many layouts is better?

        The worst margin; or the share, which moves in steps, and what tells apart layouts of the same share: the
        force that is missing on average or, where none is, what the worst point has to spare.

        Parameters and result as in `score`.
        """
        if self.force is None:
            return self.score(margins)
        spare = np.maximum(margins.min(axis=-1) / self.force - 1, 0.0)
        return self.score(margins) + LEAD * np.asarray(spare - self.missing(margins).mean(axis=-1))

    def smooth(self, margins: Floats, sharp: float) -> Floats:
        """What can gradients climb? A likeness of the merit without steps.

        The worst margin, while no force is missing anywhere. Else the share that is lost, but for a sign, with
        ``log(1 + missing / sharp)`` at each point in place of a count of the points: the smaller ``sharp`` is, the
        less it matters how much is missing.

        Source: Candes, Wakin and Boyd, "Enhancing sparsity by reweighted l1 minimization", 2008.

        Parameters
        ----------
        margins : (..., P) array
            In N.
        sharp : float
            As a share of the force.

        Returns
        -------
        (...) array
        """
        worst = margins.min(axis=-1)
        if self.force is None:
            return np.asarray(worst)
        lost = np.log1p(self.missing(margins) / sharp).mean(axis=-1)
        return np.asarray(np.where(worst < self.force, -lost, worst))

    def missing(self, margins: Floats) -> Floats:
        """Which share of the force is missing at each point? (..., P), 0 or more."""
        if self.force is None:
            return np.zeros_like(margins)
        return np.maximum(1 - margins / self.force, 0.0)

    def describe(self) -> str:
        """Say in a few words what the score is."""
        if self.force is None:
            return "the largest force in N in every direction, everywhere in the target"
        return f"the share of the target with {self.force:g} N in every direction"
