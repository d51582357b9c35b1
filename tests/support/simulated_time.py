"""Time that passes only while somebody sleeps, in place of the module `time`."""


class SimulatedTime:
    """Clock of a computer that is never late; `sleep` calls each of `watchers` as its time has passed."""

    def __init__(self):
        self._now = 1000.0
        self.watchers = []

    def monotonic(self):
        return self._now

    def sleep(self, seconds):
        self._now += seconds
        for watch in self.watchers:
            watch()
