import pytest
import qpsolvers

from tensionlab.benchmark import daqp_direct
from tensionlab.benchmark.entries import PEERS, PROGRAMS, contestants
from tensionlab.errors import UnknownSolver
from tensionlab.solvers import SOLVERS
from tensionlab.solvers.quadratic import BACKENDS


def names(found):
    return {(each.solver, each.setting) for each in found}


def test_every_family_of_the_house_and_every_peer_takes_part():
    found = contestants("all")
    families = {each.solver.partition(":")[0] for each in found if each.setting == "proved"}
    assert families == set(SOLVERS) - set(PROGRAMS)
    assert {each.solver for each in found if each.setting != "proved"} == set(PEERS)
    assert len(found) == len(names(found))
    assert not any(each.missing for each in found)


def test_peers_run_at_their_defaults_and_tight_where_they_have_such_options():
    found = names(contestants("all"))
    for backend in BACKENDS:
        assert (f"qpsolvers:{backend}", "default") in found
        assert ((f"qpsolvers:{backend}", "tight") in found) == (backend != "quadprog")
    assert {("daqp", "default"), ("daqp", "tight"), ("cvxpy:plain", "default"), ("cvxpy:plain", "tight")} <= found


def test_out_of_reach_every_policy_is_asked_for_and_programs_get_theirs():
    found = contestants("none")
    assert [each.nearest for each in found if each.solver == "newton"] == ["force", "tension", "direction"]
    assert [each.nearest for each in found if each.solver == "qp:daqp"] == ["force", "tension", "direction"]
    assert [each.nearest for each in contestants("all") if each.solver == "newton"] == ["force"]


def test_who_wants_something_else_is_marked():
    comparable = {each.solver: each.comparable for each in contestants("all")}
    assert comparable["newton"]
    assert comparable["dykstra"]
    assert comparable["qpsolvers:osqp"]
    assert not comparable["closed-form"]


def test_those_asked_for_in_their_order():
    found = contestants("all", ["daqp", "qp:daqp", "daqp"])
    assert [(each.solver, each.setting) for each in found] == [
        ("daqp", "default"),
        ("daqp", "tight"),
        ("qp:daqp", "proved"),
    ]


def test_an_unknown_name_is_refused_with_those_of_peers():
    with pytest.raises(UnknownSolver, match=r"'newtown'.*qpsolvers:osqp"):
        contestants("all", ["newtown"])


def test_what_is_not_installed_is_there_and_says_so(monkeypatch):
    monkeypatch.setattr(qpsolvers, "available_solvers", ["clarabel"])
    monkeypatch.setattr(daqp_direct, "load", _not_there)
    missing = {each.solver for each in contestants("none") if each.missing == "not installed"}
    assert {"daqp", "qpsolvers:daqp", "qpsolvers:osqp", "qp:daqp"} <= missing
    assert not {"newton", "qpsolvers:clarabel", "cvxpy:plain"} & missing


def _not_there():
    raise daqp_direct.MissingDependency("DAQP is not installed")
