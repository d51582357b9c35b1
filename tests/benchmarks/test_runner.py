"""Distribution of the times of the runner's cycles, of runs whose times are known."""

import numpy as np
import pytest

from benchmarks.runner import EDGES_US, distribution
from tensionlab.hardware.runner.records import Statistics


def test_all_cycles_of_all_runs_are_counted_and_extremes_are_in_the_outermost_bins(capsys):
    runs = [Statistics(cycles=2, missed=1, compute_times=[1e-4, 3e-4], start_delays=[0.0, 20e-6]),
            Statistics(cycles=1, missed=0, compute_times=[2e-4], start_delays=[5.0])]  # fmt: skip
    row = distribution("real-time", runs)
    assert (row["missed"], row["deadlines"]) == (1, 4)
    assert row["compute_times"]["percentiles_us"] == pytest.approx([200.0, 299.8, 300.0])
    counts = row["start_delays"]["counts"]
    assert (sum(counts), counts[0], counts[-1]) == (3, 1, 1)
    assert counts[int(np.searchsorted(EDGES_US, 20.0)) - 1] == 1
    assert capsys.readouterr().out.splitlines() == [
        "real-time: compute_times of 200 us median, 300 us at 99.9 %, 300 us at most",
        "real-time: start_delays of 20 us median, 4990000 us at 99.9 %, 5000000 us at most",
        "real-time: 1 of 4 deadlines missed",
    ]
