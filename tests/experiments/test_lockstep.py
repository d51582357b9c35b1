"""Simulated modules run much faster than time."""

from tensionlab.experiments import lockstep


def test_four_modules_keep_up_with_fifty_times_real_time():
    # The best of some runs: the machine may be busy.
    assert max(lockstep.times_real_time(4, 1.0) for _ in range(5)) > lockstep.AT_LEAST
