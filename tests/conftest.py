"""Fixtures of all tests, and the profiles of hypothesis."""

import signal

import pytest
from hypothesis import HealthCheck, settings

from tests.helpers.examples import PROFILE, many
from tests.helpers.shared import make_once

# "ci" draws few examples, the same every time; HYPOTHESIS_PROFILE=nightly draws many new ones.
settings.register_profile(
    "nightly", deadline=None, max_examples=many(100), suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("ci", settings.get_profile("nightly"), derandomize=True, database=None)
settings.load_profile(PROFILE)

signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell lets what it runs in the background ignore it


@pytest.fixture
def run(capsys):
    """Run `tensionlab` in this process: exit status, stdout, stderr."""
    from tensionlab.cli import main

    def call(*words):
        with pytest.raises(SystemExit) as left:
            main([str(word) for word in words])
        out, err = capsys.readouterr()
        return left.value.code or 0, out, err

    return call


@pytest.fixture
def simulated_time(monkeypatch):
    """Time of runs and verbs that passes only while they sleep: `SimulatedTime`."""
    from tests.helpers.simulated_time import SimulatedTime

    here = SimulatedTime()
    monkeypatch.setattr("tensionlab.hardware.runner.settings.time", here)
    return here


@pytest.fixture
def locks_folder(tmp_path, monkeypatch):
    """Folder of the locks of this test, which no other process finds."""
    folder = tmp_path / "locks"
    monkeypatch.setattr("tensionlab.hardware.client.locks.user_folders", lambda: [folder])
    return folder


@pytest.fixture
def only_clarabel(monkeypatch):
    """Of the QP solvers, find Clarabel only."""
    found = {"qpsolvers", "clarabel"}
    monkeypatch.setattr("tensionlab.solvers.quadratic.find_spec", lambda name: name in found or None)


@pytest.fixture(scope="session")
def bench_folder(tmp_path_factory):
    """The folder of a tiny benchmark, measured once for all tests that read or draw one, whichever worker's."""
    from tensionlab.benchmark.experiment import BenchmarkPlan, measure

    plan = BenchmarkPlan(
        sets=("point", "unreachable", "trajectory"),
        solvers=("newton", "closed-form", "qp:daqp", "daqp", "qpsolvers:osqp", "cvxpy:plain"),
        count=4,
        seed=3,
        seconds=0.3,  # a busy machine must not run out of it
        repeats=2,
    )

    def bench(folder):
        shares = []
        measure(plan, folder / "new", ["tensionlab", "bench", "--out", "a folder"], shares.append)
        assert shares == sorted(shares)
        assert shares[-1] == 1.0

    return make_once(tmp_path_factory, "bench", bench) / "new"


@pytest.fixture(scope="session")
def bench_results(bench_folder):
    """Its results."""
    from tensionlab.benchmark.results import read

    return read(bench_folder)
