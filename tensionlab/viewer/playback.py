"""All that a person can change on the page of a log: the time, how it passes, and what is shown beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tensionlab.support.arrays import Floats

SPEEDS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""In times of the run's own."""
ALL = "all"
"""Kind of events that stands for all of them."""
SAME_S = 1e-6
"""Times within so much are the same."""


@dataclass(frozen=True)
class Playback:
    """What is shown of a run, and how it goes on.

    Attributes
    ----------
    begin, end : float
        Times of the first and the last cycle, in s since the run began.
    time : float
        That is shown.
    speed : float
        Of playing: one of `SPEEDS`.
    playing : bool
    solver : str
        Whose answers are shown beside what was done; empty for none.
    kind : str
        Of the events that are listed and jumped to, or `ALL`.
    dark : bool
        Whether the page is dark.

    Examples
    --------
    >>> from tensionlab.viewer import playback
    >>> state = playback.play(playback.Playback(0.0, 10.0, speed=2.0))
    >>> playback.advance(state, 1.5).time
    3.0
    """

    begin: float
    end: float
    time: float = 0.0
    speed: float = 1.0
    playing: bool = False
    solver: str = ""
    kind: str = ALL
    dark: bool = False


Change = Callable[[Playback], Playback]


def seek(state: Playback, time: float) -> Playback:
    """Show another time, and stop there."""
    return replace(state, time=min(max(time, state.begin), state.end), playing=False)


def play(state: Playback) -> Playback:
    """Let time pass; at the end, from the begin."""
    over = state.time >= state.end - SAME_S
    return replace(state, time=state.begin if over else state.time, playing=True)


def pause(state: Playback) -> Playback:
    """Stop at the time that is shown."""
    return replace(state, playing=False)


def advance(state: Playback, elapsed: float) -> Playback:
    """Let so many s pass outside; it stops at the end."""
    if not state.playing:
        return state
    time = state.time + state.speed * elapsed
    return replace(state, time=min(time, state.end), playing=time < state.end)


def step(state: Playback, times: Floats, direction: int) -> Playback:
    """Go to the next of ascending times, or for -1 to the one before, and stop there; nowhere if there is none."""
    later = times > state.time + SAME_S if direction > 0 else times < state.time - SAME_S
    found = times[later]
    return seek(state, float(found[0 if direction > 0 else -1]) if len(found) else state.time)


def choose(**changes: Any) -> Change:
    """Return the change that sets attributes, such as ``speed`` or ``solver``."""
    return lambda state: replace(state, **changes)


def cycle_at(times: Floats | Sequence[float], time: float) -> int:
    """Return the index of the cycle in progress at a time; the first before them all.

    Examples
    --------
    >>> from tensionlab.viewer.playback import cycle_at
    >>> cycle_at([0.0, 0.02, 0.04], 0.03)
    1
    """
    return max(int(np.searchsorted(times, time + SAME_S, "right")) - 1, 0)
