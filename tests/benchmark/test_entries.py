import pytest

from tensionlab.benchmark import baselines
from tensionlab.benchmark import entries as entries_module
from tensionlab.benchmark.baselines import BASELINES
from tensionlab.benchmark.entries import WRAPPERS, entries
from tensionlab.errors import MissingDependency, UnknownSolver
from tensionlab.solvers import SOLVERS
from tests.helpers import batch


def names(found):
    return {(each.solver, each.setting) for each in found}


def test_every_built_in_family_and_every_baseline_is_an_entry():
    found = entries("all")
    families = {each.solver.partition(":")[0] for each in found if each.setting == "proved"}
    assert families == set(SOLVERS) - set(WRAPPERS)
    assert {each.solver for each in found if each.setting != "proved"} == set(BASELINES)
    assert len(found) == len(names(found))
    assert not any(each.missing for each in found)


def test_for_infeasible_wrenches_every_policy_runs_and_wrappers_get_theirs():
    found = entries("none")
    assert [each.policy for each in found if each.solver == "newton"] == ["force", "tension", "direction"]
    assert [each.policy for each in found if each.solver == "qp:daqp"] == ["force", "tension", "direction"]
    assert [each.policy for each in entries("all") if each.solver == "newton"] == ["force"]


def test_selected_entries_keep_their_order():
    found = entries("all", ["daqp", "qp:daqp", "daqp"])
    assert [(each.solver, each.setting) for each in found] == [
        ("daqp", "default"),
        ("daqp", "tight"),
        ("qp:daqp", "proved"),
    ]


def test_an_unknown_name_is_refused_with_those_of_baselines():
    with pytest.raises(UnknownSolver, match=r"'newtown'.*qpsolvers:osqp"):
        entries("all", ["newtown"])


@pytest.mark.usefixtures("only_clarabel")
def test_what_is_not_installed_is_there_and_says_so(monkeypatch):
    monkeypatch.setattr(baselines, "load_daqp", _not_there)
    missing = {each.solver for each in entries("none") if each.missing == "not installed"}
    assert {"daqp", "qpsolvers:daqp", "qpsolvers:osqp", "qp:daqp"} <= missing
    assert not {"newton", "qpsolvers:clarabel", "cvxpy:plain"} & missing


def _not_there():
    raise MissingDependency("DAQP is not installed")


def test_the_time_of_a_baseline_is_its_own_and_not_that_of_reading_its_answer(monkeypatch):
    """The clock is replaced by a count of what has been done."""
    done = []
    monkeypatch.setattr(entries_module.time, "perf_counter", lambda: float(len(done)))
    build, run, read = (getattr(baselines.DirectDaqp, name) for name in ("build", "run", "read"))
    for name, method, cost in (("build", build, 2), ("run", run, 3), ("read", read, 100)):
        monkeypatch.setattr(
            baselines.DirectDaqp, name, lambda *words, own=method, n=cost: done.extend([0] * n) or own(*words)
        )
    (entry,) = (each for each in entries("all", ["daqp"]) if each.setting == "default")
    problem = batch.problem([[1.0, 1.0]], [3.0], 1.0, 4.0)
    found = entries_module.driver(entry).call(problem, 0)
    assert (found.call_s, found.build_s) == (5.0, 2.0)
    assert 0.0 < found.own_s < 1.0  # of DAQP's code, in real seconds
