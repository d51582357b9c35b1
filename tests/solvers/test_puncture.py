"""The puncture method."""

from __future__ import annotations

import numpy as np
import pytest

import tensionlab as tl
from tests.helpers.examples import many
from tests.helpers.problems import random_cases


@pytest.mark.parametrize(
    ("W", "w", "lower", "upper", "answer"),
    [
        # From (1, -1) towards (4, 2): cable 2 is tight after 2/3 of the way.
        ([[1, -1]], [2], [1, 1], [5, 5], [3, 1]),
        # The least norm (4, 4) is too much for cable 1 until 4/7 of the way to (2.25, 5.75).
        ([[1, 1]], [8], [1, 1], [3, 10], [3, 5]),
        # The least norm keeps the limits.
        ([[1, 1]], [6], [1, 1], [5, 9], [3, 3]),
        # A fixed cable takes 2; the others begin at (3, 3) and go on to (2.5, 3.5), but need not.
        ([[1, 1, 1]], [8], [2, 1, 2], [2, 4, 5], [2, 3, 3]),
        # The second component is beyond all cables; the first is rendered.
        ([[1, -1], [0, 0]], [2, 7], [1, 1], [5, 5], [3, 1]),
        # Out of reach: the end of the way, (5.25, 8.75), clipped.
        ([[1, 1]], [14], [1, 1], [3, 10], [3, 8.75]),
        # No way at all: every cable is fixed.
        ([[1, 1]], [9], [2, 3], [2, 3], [2, 3]),
    ],
)
def test_known_by_hand(W: object, w: object, lower: object, upper: object, answer: object) -> None:
    found = tl.allocate(W, w, (lower, upper), "puncture")  # type: ignore[arg-type]
    np.testing.assert_allclose(found.tensions, answer, rtol=0, atol=1e-12)  # type: ignore[arg-type]


@pytest.mark.parametrize(("n", "m"), [(2, 4), (3, 5), (3, 8), (6, 8), (6, 12), (3, 2)])
def test_least_share_of_the_way_that_keeps_the_limits(n: int, m: int) -> None:
    batch = random_cases(n + m, n, m, many(400))
    W, w, low, high = batch.structure, batch.wrench, batch.lower, batch.upper
    found = tl.allocate(W, w, batch.limits, "puncture")
    middle = (low + high) / 2
    inverse = np.linalg.pinv(W)
    least = np.einsum("bmn,bn->bm", inverse, w)
    central = middle + np.einsum("bmn,bn->bm", inverse, w - np.einsum("bnm,bm->bn", W, middle))
    share = np.linspace(0, 1, 1001)[:, None, None]
    line = least + share * (central - least)
    keeps = np.all((line >= low - 1e-9) & (line <= high + 1e-9), axis=2)
    some = keeps.any(axis=0)
    assert 0.1 * len(w) < np.count_nonzero(some) < len(w)
    # The answer lies on the line, no more than a step before the first point of the grid that keeps the limits.
    first = keeps.argmax(axis=0)
    way = central - least
    length = np.maximum(np.sum(way**2, axis=1), 1e-300)
    s = np.sum((found.tensions - least) * way, axis=1) / length
    np.testing.assert_allclose((least + s[:, None] * way)[some], found.tensions[some], rtol=0, atol=1e-8)
    moves = some & (length > 1e-12)
    assert np.all(s[moves] <= share[first[moves], 0, 0] + 1e-9)
    assert np.all(s[moves] >= share[first[moves], 0, 0] - 1.001e-3)
    np.testing.assert_allclose(found.tensions[~some], np.clip(central, low, high)[~some], rtol=0, atol=1e-8)


def test_covers_what_the_closed_form_covers_with_less_tension() -> None:
    batch = random_cases(8, 6, 8, many(1000))
    found = tl.allocate(batch.structure, batch.wrench, batch.limits, "puncture")
    central = tl.allocate(batch.structure, batch.wrench, batch.limits, "pseudoinverse:middle")
    assert np.all(found.status[central.status == tl.Status.EXACT] == tl.Status.EXACT)
    assert found.counts()[tl.Status.EXACT] > central.counts()[tl.Status.EXACT]
    both = central.status == tl.Status.EXACT
    effort = (np.sum(each.tensions[both] ** 2, axis=1) for each in (found, central))
    assert np.all(next(effort) <= next(effort) + 1e-9)
