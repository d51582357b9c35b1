"""Solvers side by side on the design page."""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.solver_comparison import answer, compare, problems
from tensionlab.viewer.state import STUDIES, begin


@pytest.fixture
def point():
    state = begin(tl.load_rig("bartels2026-validation"))
    chosen = edits.set_fields(compared=("minimax", "dykstra"), study="force in a circle")
    return chosen(edits.set_wrench(state, [1.5, 0.0, 0.0]))


def test_the_studies_are_level_circles_and_the_directions_of_the_validation(point):
    circle, around, hand = (problems(edits.set_fields(study=study)(point)) for study in STUDIES)
    assert np.linalg.norm(circle.forces, axis=1) == pytest.approx(np.full(180, 1.5))
    assert not circle.forces[:, 1].any()  # Y is up
    assert np.degrees(np.arctan2(circle.forces[45, 2], circle.forces[45, 0])) == pytest.approx(circle.along[45])
    assert len(around.forces) == 182
    assert np.ptp(hand.forces, axis=0).tolist() == [0.0, 0.0, 0.0]
    assert np.linalg.norm(hand.positions - point.position, axis=1) == pytest.approx(np.full(180, 0.23))


def test_answers_are_those_of_the_interface(point):
    study, found = compare(point, lambda: True)
    assert [answers.solver for answers in found] == ["newton", "minimax", "dykstra"]
    structure, limits = point.rig.structure_matrix(point.rig.home), point.rig.limits
    for answers in found:
        direct = tl.allocate(structure, study.forces, limits, solver=answers.solver)
        assert answers.study.tensions == pytest.approx(direct.tensions)
        now = tl.allocate(structure, point.wrench, limits, solver=answers.solver)
        assert answers.now.tensions == pytest.approx(now.tensions)
        assert answers.seconds > 0.0
    assert compare(point, lambda: False) is None  # it is no longer wanted


def test_the_required_wrench_is_exerted_in_addition_to_each_force():
    state = edits.set_fields(study="force in a circle")(begin(tl.load_rig("cogiro")))
    found = answer(state, "newton", problems(state))
    assert found.now.status == tl.Status.EXACT
    assert (found.study.wrench[:, 2] > 800.0).all()  # the weight of 91 kg


def test_a_solver_with_other_policies_keeps_its_own_and_one_for_other_rigs_says_so(point):
    state = edits.set_fields(policy="direction")(point)
    assert answer(state, "dykstra", problems(state)).problem == ""
    state = begin(tl.load_rig("seven-modules"))
    assert "does not support this problem" in answer(state, "polygon", problems(state)).problem


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("name", ["kntu-planar", "ipanema-2", "body-mounted"])
def test_every_kind_of_rig_can_be_studied(name, study):
    state = edits.set_fields(study=study)(begin(tl.load_rig(name)))
    found = answer(state, "newton", problems(state))
    assert found.problem == ""
    assert len(found.study.status) == len(problems(state).forces)
