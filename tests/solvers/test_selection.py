import pytest

import tensionlab as tl
from tensionlab.errors import InputError, MissingDependency, UnknownSolver
from tensionlab.solvers import SOLVERS, every_solver, make, select_solvers
from tensionlab.solvers import registry as room


def test_every_name_makes_a_solver_and_every_family_is_there():
    names = every_solver()
    for name in names:
        make(name)
    assert {name.partition(":")[0] for name in names} == set(SOLVERS)


def test_every_solver_runs_with_every_policy_it_supports():
    runs, missing = select_solvers()
    assert {run.name for run in runs} | set(missing) == set(every_solver())
    for name, policy, _ in runs:
        supported = make(name).policies
        assert policy in supported if supported else policy is None
    assert {policy for name, policy, _ in runs if name == "newton"} == {"force", "tension", "direction"}


def test_one_policy_leaves_out_those_that_do_not_support_it():
    runs, _ = select_solvers(policy="force")
    assert {policy for _, policy, _ in runs} == {"force"}
    names = {run.name for run in runs}
    assert {"newton", "cvxpy"} <= names
    assert not {"dykstra", "pseudoinverse:middle", "closed-form"} & names


def test_order_is_kept_and_repeats_are_not():
    runs, missing = select_solvers(["closed-form", "dykstra", "closed-form"])
    assert [run[:2] for run in runs] == [("closed-form", None), ("dykstra", "tension")]
    assert not missing


@pytest.mark.parametrize(
    ("solvers", "policy", "message"),
    [
        (None, "closest", "force, tension, direction"),
        (["dykstra"], "force", "dykstra.*supports 'tension'"),
        (["dykstra", "spidar"], "force", "no solver is left: dykstra .*supports 'tension'.*spidar"),
        (["closed-form"], "force", "promises no best substitute"),
        ([], None, "no solver is named"),
        ("newton", None, r"solvers is 'newton'; give a list of names"),
    ],
)
def test_what_cannot_be_supported_is_a_value_error(solvers, policy, message):
    with pytest.raises(ValueError, match=message):
        select_solvers(solvers, policy)


def test_a_solver_that_does_not_serve_the_size_is_left_out_by_default_and_refused_by_name():
    runs, missing = select_solvers(size=(3, 8))
    reason = "8 cables for 3 wrench components have redundancy 5, and a polygon has 2 dimensions"
    assert missing["polygon:1-norm"] == reason
    assert "polygon:1-norm" not in {run.name for run in runs}
    assert "polygon:1-norm" in {run.name for run in select_solvers(size=(6, 8))[0]}
    with pytest.raises(ValueError, match=r"polygon does not support this rig: .*redundancy 3"):
        select_solvers(["newton", "polygon"], size=(3, 6))


def test_instances_are_called_by_their_class_and_what_is_not_the_default():
    given = [
        tl.solvers.Dykstra(),
        tl.solvers.Dykstra(iteration_limit=2),
        "newton",
        tl.solvers.QuadraticProgram("osqp"),
        tl.solvers.Dykstra(),
    ]
    runs, _ = select_solvers(given, "tension")
    assert [run.name for run in runs] == ["dykstra", "dykstra(iteration_limit=2)", "newton", "qp(backend='osqp')"]
    assert runs[1].solver is given[1]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([tl.solvers.Newton], r"the class Newton; give an instance, Newton\(\)"),
        ([3.0], "3.0, which lacks objective, policies, solve"),
        (tl.solvers.Newton(), "give a list of names and instances"),
    ],
)
def test_what_is_no_solver_is_refused_in_words(given, message):
    with pytest.raises(InputError, match=message):
        select_solvers(given)


def test_unknown_names_are_unknown_solvers():
    with pytest.raises(UnknownSolver, match="newton"):
        select_solvers(["newtown"])


def test_a_backend_that_is_not_installed_is_left_out_by_default_and_refused_by_name(monkeypatch):
    monkeypatch.setattr(room, "installed_backends", lambda: ("clarabel",))
    runs, missing = select_solvers()
    assert "qp:daqp" in missing
    assert "qp:clarabel" not in missing
    assert not set(missing) & {run.name for run in runs}
    with pytest.raises(MissingDependency, match=r"qp:daqp.*tensionlab\[solvers\]"):
        select_solvers(["newton", "qp:daqp"])
