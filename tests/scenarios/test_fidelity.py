"""Fidelity of a run by its log: what is infeasible is told, and is no failure."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.hardware.log.reader import flat_columns, read_run
from tensionlab.scenarios import load_scenario
from tensionlab.scenarios.fidelity import run_fidelity
from tensionlab.scenarios.play import play, simulate_modules
from tensionlab.solvers.base import Status
from tests.helpers.runs import logged, seven


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run without effects, whose force goes round."""
    path = tmp_path_factory.mktemp("logs") / "run.mcap"
    logged(path, seven(), 200, rate=100.0)
    return read_run(path)


def test_a_run_without_effects_is_judged_by_its_force(run):
    found = run_fidelity(run)
    assert list(found) == ["force"]
    assert found["force"].force == pytest.approx(2.0 * np.sqrt(1.5), rel=0.05)
    assert found["force"].latency == pytest.approx(0.01, abs=0.003)  # as the helper has it: a cycle late


def test_what_is_proved_infeasible_is_excused(run):
    halved = replace(run, measured=0.4 * run.measured, rendered=0.4 * run.rendered)
    assert run_fidelity(halved)["force"].passed is False
    proved = replace(halved, status=np.full(len(run), Status.NEAREST, dtype=np.int8))
    assert run_fidelity(proved)["force"].passed is None
    assert run_fidelity(proved)["force"].failures()


def test_effects_are_in_the_log_as_they_were_desired():
    weight = load_scenario("weight")
    run = play(weight, simulate_modules(weight), seconds=1.5).run
    desired = run.effects["weight"]
    active = np.isfinite(desired.share)
    assert run.time[active].min() == pytest.approx(0.5)
    assert desired.force[active] == pytest.approx(run.desired[active], abs=1e-9)
    assert set(run.to_xarray().effect.values) == {"weight"}
    assert flat_columns(run)["effect.weight.Fz"][-1] == pytest.approx(desired.force[-1, 2])
