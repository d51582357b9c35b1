"""Time that passes only while code sleeps, in place of the module `time`."""

START_S = 1000.0
LONGEST_S = 3600.0  # no test sleeps for longer: something that should end does not


class SimulatedTime:
    """Clock of a computer that is never late; `sleep` calls each of `watchers` as its time has passed."""

    def __init__(self):
        self._now = START_S
        self.watchers = []

    def perf_counter(self):
        return self._now

    def sleep(self, seconds):
        self.jump(seconds)
        for watch in self.watchers:
            watch()

    def jump(self, seconds):
        """Let time pass without running anything, as on a computer that is held up."""
        self._now += seconds
        assert self._now < START_S + LONGEST_S
