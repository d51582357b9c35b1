import numpy as np
import pytest

from tensionlab.hardware.log.reader import read_run, report
from tensionlab.solvers.base import Status
from tests.support import runs


def test_counts_and_shares_are_those_of_the_cycles(tmp_path):
    rig = runs.seven()
    cycles = runs.logged(tmp_path / "run.mcap", rig, 200, solver="dykstra", lost=2)
    found = report(read_run(tmp_path / "run.mcap"))
    assert (found.rig, found.solver, found.nearest) == ("seven-modules", "dykstra", "tension")
    statistics = found.statistics
    assert (statistics.cycles, statistics.missed, statistics.slew_limited) == (200, 0, 0)
    assert found.duration_s == pytest.approx(199 / 50)
    statuses = [int(cycle.allocation.status) for cycle in cycles]
    assert [statistics.statuses[status] for status in Status] == [statuses.count(status) for status in range(4)]
    assert statistics.statuses[Status.NEAREST] > 5
    assert statistics.fallback_used == sum(cycle.fallback_used for cycle in cycles)
    assert statistics.percentiles()["start_delay"] == pytest.approx(
        np.percentile([cycle.start_delay for cycle in cycles], [50, 99, 100])
    )
    assert found.complete
    assert statistics.ended == "stopped by the demand"

    lost, kept = found.modules[2], found.modules[3]
    assert (lost.name, lost.faults, lost.lost_at_s) == (rig.modules[2].name, ["ENCODER"], 2.0)
    assert (kept.faults, kept.lost_at_s) == ([], None)
    taut = np.mean([cycle.state.limiters[3] == 1 for cycle in cycles])
    assert kept.limiters == {"LOWER": pytest.approx(taut)}
    sent = [cycle.commanded[2] for cycle in cycles[:100]]
    assert (lost.commanded_min_n, lost.commanded_mean_n) == pytest.approx((min(sent), np.mean(sent)))
    assert 0.005 < kept.telemetry_age_s["median"] < kept.telemetry_age_s["max"] < 0.03


def test_missed_deadlines_are_seen_in_the_times(tmp_path):
    log = runs.new_log(tmp_path / "run.mcap", runs.four())
    for cycle in runs.cycles(runs.four(), 100):
        if cycle.state.cycle not in (30, 31, 70):
            log.write(cycle)
    log.close()
    assert report(read_run(tmp_path / "run.mcap")).statistics.missed == 3


def test_set_points_that_were_slowed_are_counted(tmp_path):
    log = runs.new_log(tmp_path / "run.mcap", runs.four())
    for cycle in runs.cycles(runs.four(), 20):
        if cycle.state.cycle < 5:
            cycle.commanded[0] -= 0.1
        log.write(cycle)
    log.close()
    assert report(read_run(tmp_path / "run.mcap")).statistics.slew_limited == 5


def test_a_run_without_a_cycle_has_nothing_to_report(tmp_path):
    runs.logged(tmp_path / "run.mcap", runs.four(), 0)
    found = report(read_run(tmp_path / "run.mcap"))
    assert (found.statistics.cycles, found.statistics.missed, found.duration_s) == (0, 0, 0.0)
    assert np.isnan(found.statistics.percentiles()["start_delay"]).all()
    assert found.modules[0].limiters == {}
