import dataclasses

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.replay import replay
from tensionlab.hardware.log.reader import read_run
from tests.helpers import runs


@pytest.fixture(scope="module")
def lossy(tmp_path_factory):
    """A run of seven modules by Dykstra's algorithm, of which one is lost half way."""
    file = tmp_path_factory.mktemp("logs") / "run.mcap"
    runs.logged(file, runs.seven(), 200, solver="dykstra", lost=2)
    return read_run(file)


def test_the_runs_own_solver_scores_as_the_run_did(lossy):
    found = replay(lossy, ["dykstra", "newton"])
    run, again, other = found.rows
    ignored = {"gap_max": 0.0, "call_median_s": 0.0, "call_p99_s": 0.0, "batch_s": 0.0}
    assert dataclasses.replace(run, **ignored) == dataclasses.replace(again, **ignored)
    assert (run.solver, run.policy) == ("dykstra", "tension")
    assert (other.solver, other.policy) == ("newton", "force")
    assert len(found.wrenches) == 196  # in four of them, no wrench was desired
    assert run.exact + run.nearest_count == 196
    assert other.residual_max < run.residual_max  # nearest in force is what newton promises


def test_scores_are_what_they_say(lossy):
    run, newton = replay(lossy, ["newton"]).rows
    desired = np.isfinite(lossy.desired[:, 0])
    wrenches, rendered, chosen = lossy.desired[desired], lossy.rendered[desired], lossy.chosen[desired]
    assert run.residual_max == pytest.approx(np.linalg.norm(wrenches - rendered, axis=1).max())
    assert run.tension_max == chosen.max()
    assert run.tension_sq_mean == pytest.approx((chosen**2).mean())
    assert run.iterations_max == lossy.iterations[desired].max()
    jumps = [
        abs(lossy.chosen[k] - lossy.chosen[k - 1]).max()
        for k in range(1, len(lossy))
        if desired[k] and desired[k - 1] and (lossy.active[k] == lossy.active[k - 1]).all()
    ]
    assert run.step_max == pytest.approx(max(jumps))
    assert newton.failed == newton.unproven == 0


def test_a_jump_is_from_one_cycle_to_the_next(lossy):
    """A pause in the demands is none."""
    pause = (lossy.cycle >= 20) & (lossy.cycle < 60)
    paused = dataclasses.replace(lossy, desired=np.where(pause[:, None], np.nan, lossy.desired))
    there = abs(lossy.chosen[60] - lossy.chosen[19]).max()
    assert replay(paused, ["newton"]).rows[0].step_max <= replay(lossy, ["newton"]).rows[0].step_max < there


def test_modules_that_took_no_part_take_none_in_the_replay(lossy, monkeypatch):
    limits = []
    real = tl.Allocator.__init__

    def spy(self, given, *words, **named):
        limits.append(given)
        real(self, given, *words, **named)

    monkeypatch.setattr(tl.Allocator, "__init__", spy)
    replay(lossy, ["newton"])
    (lower, upper) = limits[0]
    assert lower.shape == upper.shape == (196, 7)
    assert (upper[-90:, 2] == 0.0).all()
    assert (upper[:90] == 6.0).all()
    assert (lower[-90:, [0, 1, 3, 4, 5, 6]] == 0.5).all()


def test_all_solvers_that_serve_the_rig_are_in_the_replay(lossy):
    found = replay(dataclasses.replace(lossy, desired=np.where(lossy.cycle[:, None] < 5, lossy.desired, np.nan)))
    names = [row.solver for row in found.rows[1:]]
    assert len(found.wrenches) == 5
    assert {"newton", "dykstra", "closed-form", "qp:daqp", "cvxpy"} <= set(names)
    assert len(names) == len(set(names))
    assert "polygon:centroid" in found.missing


def test_a_solver_that_does_not_serve_the_rig_is_refused(lossy):
    with pytest.raises(ValueError, match="polygon does not serve this rig"):
        replay(lossy, ["polygon"])


def test_without_demands_nothing_is_scored(tmp_path):
    runs.logged(tmp_path / "run.mcap", runs.four(), 0)
    found = replay(read_run(tmp_path / "run.mcap"), ["newton", "dykstra"])
    assert len(found.wrenches) == 0
    assert [row.exact for row in found.rows] == [0, 0, 0]
