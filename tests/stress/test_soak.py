"""A long run on bad links and killed hosts; and that the checks of a run can fail."""

from dataclasses import fields, replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.hardware.log.reader import Run, read_run
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.simulation.simulated_module import COLUMNS
from tests.stress import cases
from tests.stress.soak import LARGEST_ERROR, TRANSIT_S, TTL, LimitWatch, examine, kills, soak

SECONDS = cases(8)
NOT_REPEATED = {"path", "began", "compute_time", "summary", "manifest"}  # what the host's own clock has a part in


@pytest.fixture(scope="module")
def soaked(tmp_path_factory):
    log = tmp_path_factory.mktemp("soak") / "soak.mcap"
    return soak(SECONDS, log, seed=5), read_run(log)


def test_seven_modules_behind_bad_links(soaked):
    found, run = soaked
    assert found.problems(TTL + TRANSIT_S, LARGEST_ERROR) == []
    assert found.cycles == 50 * SECONDS
    assert found.compared > 0.8 * found.cycles  # where no report is late

    wrong = run.last_sequence.copy()
    wrong[300] = run.sequences[290]  # as if all had gone back by some set-points
    assert examine(replace(run, last_sequence=wrong)).went_back
    weak = examine(replace(run, measured=1.2 * run.measured))
    assert "the force was off by" in weak.problems(TTL + TRANSIT_S, LARGEST_ERROR)[0]
    strong = replace(run, commanded=np.where(np.arange(len(run))[:, None] == 9, 6.01, run.commanded))
    assert examine(strong).outside == 7


def test_the_same_seed_gives_the_same_log_and_another_one_another(tmp_path):
    names = [field.name for field in fields(Run) if field.name not in NOT_REPEATED]

    def logged(name, seed):
        log = tmp_path / f"{name}.mcap"
        soak(cases(2), log, seed)
        return read_run(log)

    first, again, other = logged("first", 5), logged("again", 5), logged("other", 4)
    assert [name for name in names if not same(getattr(first, name), getattr(again, name))] == []
    assert not any(same(getattr(first, name), getattr(other, name)) for name in ("sequences", "lengths", "ages"))


def same(one, other):
    if isinstance(one, np.ndarray):
        return one.tobytes() == other.tobytes()
    return repr(one) == repr(other)


def test_pulling_with_more_or_less_than_the_limits_is_seen():
    watch = LimitWatch(tl.TensionLimits([0.5], [6.0]))

    def seen(*commanded, state=State.RUNNING):
        samples = np.zeros((len(commanded), len(COLUMNS)))
        samples[:, COLUMNS["commanded"]], samples[:, COLUMNS["state"]] = commanded, state
        watch([samples])
        return watch.outside

    assert seen(0.0, 0.2, 0.5, 3.0) == 0  # it begins from nothing
    assert seen(6.0, 0.5) == 0
    assert seen(0.4) == 1
    assert seen(0.5, 6.1) == 2
    assert seen(0.5, 0.0, state=State.TIMEOUT) == 2
    assert seen(0.0, 0.5) == 2


@pytest.mark.realtime  # hosts are killed with -9
def test_logs_of_hosts_that_are_killed(tmp_path):
    assert kills(2 + cases(1), tmp_path) == []
