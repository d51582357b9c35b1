"""Lines that say what clients do, for whoever serves them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

REPORT_S = 5.0
"""For so long the same line is counted, not said again."""
MAX_LINES = 20
"""In that time."""


class LimitedReport:
    """Report, line by line: each at once, but one that was said a moment ago, or too many, only as a number.

    Parameters
    ----------
    say : callable
        Called with one line, from whichever thread reports.
    clock : callable
        Time in s.
    """

    def __init__(self, say: Callable[[str], None], clock: Callable[[], float] = time.perf_counter) -> None:
        self._say, self._clock = say, clock
        self._lock = threading.Lock()
        self._said: set[str] = set()
        self._more, self._since = 0, clock()

    def __call__(self, line: str) -> None:
        """Say a line, or count it."""
        if self._clock() - self._since >= REPORT_S:
            self.finish()
        with self._lock:
            fresh = line not in self._said and len(self._said) < MAX_LINES
            if fresh:
                self._said.add(line)
            else:
                self._more += 1
        if fresh:
            self._say(line)

    def finish(self) -> None:
        """Say how many more there were, and begin anew."""
        with self._lock:
            more, self._more, self._since = self._more, 0, self._clock()
            self._said.clear()
        if more:
            self._say(f"{more} more lines like these")
