"""Solvers side by side on the design page."""

import re

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.solver_comparison import answer, compare, problems, solver_table
from tensionlab.viewer.state import STUDIES, begin
from tests.helpers.browsers import plain


@pytest.fixture
def point():
    state = begin(tl.load_rig("bartels2026-validation"))
    return edits.set_fields(compared=("minimax", "dykstra"), study="force in a circle")(
        edits.set_wrench(state, [1.5, 0.0, 0.0])
    )


def test_the_circle_is_level_and_as_strong_as_the_desired_force(point):
    study = problems(point)
    assert np.linalg.norm(study.forces, axis=1) == pytest.approx(np.full(180, 1.5))
    assert not study.forces[:, 1].any()  # Y is up
    assert np.degrees(np.arctan2(study.forces[45, 2], study.forces[45, 0])) == pytest.approx(study.along[45])


def test_all_directions_are_those_of_the_validation(point):
    study = problems(edits.set_fields(study="force in all directions")(point))
    assert len(study.forces) == 182


def test_the_hand_goes_around_with_the_same_force(point):
    study = problems(edits.set_fields(study="hand in a circle")(point))
    assert np.ptp(study.forces, axis=0).tolist() == [0.0, 0.0, 0.0]
    assert np.linalg.norm(study.positions - point.position, axis=1) == pytest.approx(np.full(180, 0.23))


def test_answers_are_those_of_the_interface(point):
    study, found = compare(point, lambda: True)
    assert [each.solver for each in found] == ["newton", "minimax", "dykstra"]
    rig = point.rig
    structure = rig.structure_matrix(rig.home)
    for each in found:
        direct = tl.allocate(structure, study.forces, rig.limits, solver=each.solver)
        assert each.study.tensions == pytest.approx(direct.tensions)
        now = tl.allocate(structure, point.wrench, rig.limits, solver=each.solver)
        assert each.now.tensions == pytest.approx(now.tensions)
        assert each.seconds > 0.0


def test_what_a_rig_requires_is_held_beside_each_force():
    state = edits.set_fields(study="force in a circle")(begin(tl.load_rig("cogiro")))
    found = answer(state, "newton", problems(state))
    assert found.now.status == tl.Status.EXACT
    assert (found.study.wrench[:, 2] > 800.0).all()  # the weight of 91 kg


def test_a_policy_that_a_solver_has_not_is_left_to_it(point):
    state = edits.set_fields(policy="direction")(point)
    assert answer(state, "dykstra", problems(state)).problem == ""


def test_a_solver_that_serves_no_such_rig_says_so(point):
    state = edits.set_fields(study="force in a circle")(begin(tl.load_rig("seven-modules")))
    assert "serves no such problem" in answer(state, "polygon", problems(state)).problem


def test_a_comparison_ends_as_soon_as_it_is_not_wanted(point):
    assert compare(point, lambda: False) is None


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("name", ["kntu-planar", "ipanema-2", "body-mounted"])
def test_every_kind_of_rig_can_be_studied(name, study):
    state = edits.set_fields(study=study)(begin(tl.load_rig(name)))
    found = answer(state, "newton", problems(state))
    assert found.problem == ""
    assert len(found.study.status) == len(problems(state).forces)


def test_the_table_has_a_row_for_each_solver(point):
    _, answers = compare(edits.set_wrench(point, [20.0, 0.0, 0.0]), lambda: True)
    text = plain(solver_table(answers)._repr_html_())
    assert re.search(r"■ newton NEAREST 15.1 6.00 \S+ .s 0/180", text)
    assert "■ dykstra " in text
