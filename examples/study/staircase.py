"""Adaptive staircase for two-interval discrimination, a fit of the threshold, and a simulated subject.

Copy this file into your study; it needs NumPy and SciPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

TARGET = 0.75  # share of correct answers at the threshold; guessing has 0.5
LAPSES = 0.02  # share of trials in which a subject answers without attention
SIGMAS_PER_THRESHOLD = 1.0 / ndtri(TARGET)  # standard deviation of the difference of two percepts
GRID = np.geomspace(0.1, 200.0, 1001)  # possible thresholds, in % of the standard


@dataclass
class Staircase:
    """Weighted up-down staircase on a logarithmic scale.

    After a correct answer the difference is divided by a step, after a wrong one multiplied by its third power:
    it settles where 75 % of the answers are correct (Kaernbach 1991, "Simple adaptive testing with the weighted
    up-down method", Perception & Psychophysics 49). The first reversals have a larger step, to come there soon.
    """

    level: float = 40.0  # difference of the next trial, in % of the standard
    largest: float = 60.0  # what the device can render, in %
    smallest: float = 0.5  # what it can render reliably, in %
    steps: tuple[float, float] = (1.2, 1.1)  # factor after a correct answer: until `coarse` reversals, and after
    coarse: int = 2
    left_out: int = 4  # first reversals, which do not count for their mean
    levels: list[float] = field(default_factory=list)  # of the trials so far
    correct: list[bool] = field(default_factory=list)

    def answer(self, correct: bool) -> None:
        """Take the answer to a trial at the current level, and choose the next level."""
        self.levels.append(self.level)
        self.correct.append(correct)
        step = self.steps[len(self.reversals) > self.coarse]
        ratio = TARGET / (1.0 - TARGET)
        self.level = float(np.clip(self.level * step ** (-1.0 if correct else ratio), self.smallest, self.largest))

    @property
    def reversals(self) -> list[int]:
        """Trials whose answer differs from the one before, by their number from 0."""
        return [trial for trial in range(1, len(self.correct)) if self.correct[trial] != self.correct[trial - 1]]

    def mean_of_reversals(self) -> float:
        """Return the geometric mean of the levels at reversals after those that are left out."""
        return float(np.exp(np.mean(np.log([self.levels[trial] for trial in self.reversals[self.left_out :]]))))


class Threshold(NamedTuple):
    """Threshold in % of the standard, and the ends of its interval."""

    value: float
    low: float
    high: float


def proportion_correct(difference: np.ndarray, threshold: np.ndarray | float) -> np.ndarray:
    """Return the share of correct answers at differences, by the model of an observer with Gaussian noise.

    ``lapses / 2 + (1 - lapses) Phi(difference / sigma)``: Green and Swets 1966, "Signal Detection Theory and
    Psychophysics"; lapses after Wichmann and Hill 2001, "The psychometric function", Perception & Psychophysics
    63. Without lapses, it is 75 % at the threshold.
    """
    return LAPSES / 2 + (1.0 - LAPSES) * ndtr(difference / (SIGMAS_PER_THRESHOLD * threshold))


def fit_threshold(levels: Sequence[float], correct: Sequence[bool], share: float = 0.95) -> Threshold:
    """Return the median of the threshold given all answers, and the interval that has a share of the probability.

    Before any answer, every threshold of `GRID`, which is logarithmic, is equally likely (Watson and Pelli 1983,
    "QUEST: a Bayesian adaptive psychometric method", Perception & Psychophysics 33).
    """
    right = proportion_correct(np.asarray(levels, dtype=float)[:, None], GRID)
    logs = np.where(np.asarray(correct, dtype=bool)[:, None], np.log(right), np.log1p(-right)).sum(axis=0)
    summed = np.cumsum(np.exp(logs - logs.max()))
    quantiles = np.array([0.5, (1.0 - share) / 2.0, (1.0 + share) / 2.0])
    return Threshold(*np.exp(np.interp(quantiles, summed / summed[-1], np.log(GRID))).tolist())


@dataclass
class Subject:
    """Simulated subject with a known threshold, in % of the standard: its percepts have Gaussian noise."""

    threshold: float
    standard: float
    rng: np.random.Generator

    def choose(self, first: float, second: float) -> int:
        """Return which of two stimuli feels stronger, 1 or 2."""
        if self.rng.random() < LAPSES:
            return int(self.rng.integers(1, 3))
        sigma = SIGMAS_PER_THRESHOLD * self.threshold / 100.0 * self.standard / np.sqrt(2.0)
        percepts = np.array([first, second]) + self.rng.normal(0.0, sigma, 2)
        return int(np.argmax(percepts)) + 1
