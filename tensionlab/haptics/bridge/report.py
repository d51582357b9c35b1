"""Report of what clients do, as lines for a terminal."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable

REPORT_S = 5.0  # for so long the same line is counted, not said again
MAX_LINES = 20  # in that time
MAX_REASONS = 5  # that are said with their numbers at its end


class LimitedReport:
    """Report, line by line: each at once, but one that was said a moment ago, or too many, only as a number.

    A line begins with who it is about and ``: ``; lines that go on alike are counted together.

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
        self._more: Counter[str] = Counter()
        self._since = clock()

    def __call__(self, line: str) -> None:
        """Say a line, or count it."""
        if self._clock() - self._since >= REPORT_S:
            self.finish()
        with self._lock:
            fresh = line not in self._said and len(self._said) < MAX_LINES
            if fresh:
                self._said.add(line)
            else:
                self._more[line.partition(": ")[2] or line] += 1
        if fresh:
            self._say(line)

    def finish(self) -> None:
        """Say how many more there were of each kind, and begin anew."""
        with self._lock:
            more, self._more, self._since = self._more, Counter(), self._clock()
            self._said.clear()
        often = more.most_common(MAX_REASONS)
        for reason, count in often:
            self._say(f"{_times(count)}: {reason}")
        if rest := more.total() - sum(count for _, count in often):
            self._say(f"{_times(rest)}: something else")


def _times(count: int) -> str:
    return "once more" if count == 1 else f"{count} more times"
