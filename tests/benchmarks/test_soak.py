"""Half a minute of `make soak`; and that its checks can fail."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.soak import LARGEST_ERROR, ON_THE_WAY, TTL, kills, soak
from benchmarks.soak_checks import examine
from tensionlab.hardware.log.reader import read_run

pytestmark = pytest.mark.realtime  # seven modules and hosts in processes


@pytest.mark.slow
def test_seven_modules_behind_bad_links(tmp_path):
    found = soak(30.0, tmp_path)
    assert found.problems(TTL + ON_THE_WAY, LARGEST_ERROR) == []
    assert found.cycles > 1400
    assert found.compared > 0.9 * found.cycles

    run = read_run(tmp_path / "soak.mcap")
    wrong = run.last_sequence.copy()
    wrong[700] = run.sequences[690]  # as if all had gone back by some set-points
    assert examine(replace(run, last_sequence=wrong), []).went_back
    weak = examine(replace(run, measured=1.2 * run.measured), [])
    assert "the force was off by" in weak.problems(TTL + ON_THE_WAY, LARGEST_ERROR)[0]
    strong = replace(run, commanded=np.where(np.arange(len(run))[:, None] == 9, 6.01, run.commanded))
    assert examine(strong, []).outside == 7


@pytest.mark.slow
def test_logs_of_hosts_that_are_killed(tmp_path):
    assert kills(5, tmp_path) == []
