"""Solvers side by side on the design page."""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.support.colours import rgb
from tensionlab.viewer import state as edits
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.solver_study import answer, compare, points, problems
from tensionlab.viewer.state import STUDIES, begin


@pytest.fixture
def point():
    state = begin(tl.load_rig("bartels2026-validation"))
    return edits.choose(compared=("minimax", "dykstra"), study="force in a circle")(
        edits.desire(state, [1.5, 0.0, 0.0])
    )


def test_the_circle_is_level_and_as_strong_as_the_desired_force(point):
    asked = problems(point)
    assert np.linalg.norm(asked.forces, axis=1) == pytest.approx(np.full(180, 1.5))
    assert not asked.forces[:, 1].any()  # Y is up
    assert np.degrees(np.arctan2(asked.forces[45, 2], asked.forces[45, 0])) == pytest.approx(asked.along[45])


def test_all_directions_are_those_of_the_validation(point):
    asked = problems(edits.choose(study="force in all directions")(point))
    assert len(asked.forces) == 182
    assert not asked.ordered


def test_the_hand_goes_around_with_the_same_force(point):
    asked = problems(edits.choose(study="hand in a circle")(point))
    assert np.ptp(asked.forces, axis=0).tolist() == [0.0, 0.0, 0.0]
    assert np.linalg.norm(asked.positions - point.position, axis=1) == pytest.approx(np.full(180, 0.23))


def test_answers_are_those_of_the_interface(point):
    asked, found = compare(point, lambda: True)
    assert [each.solver for each in found] == ["newton", "minimax", "dykstra"]
    rig = point.rig
    structure = rig.structure_matrix(rig.home)
    for each in found:
        direct = tl.allocate(structure, asked.forces, rig.limits, solver=each.solver)
        assert each.study.tensions == pytest.approx(direct.tensions)
        now = tl.allocate(structure, point.wrench, rig.limits, solver=each.solver)
        assert each.now.tensions == pytest.approx(now.tensions)
        assert each.seconds > 0.0


def test_the_jump_is_the_largest_change_between_neighbours_around_the_circle(point):
    asked = problems(point)
    found = answer(point, "minimax", asked)
    steps = found.study.tensions - np.roll(found.study.tensions, 1, axis=0)
    assert found.jump == pytest.approx(np.abs(steps).max())


def test_what_is_drawn_says_which_forces_are_exact(point):
    state = edits.desire(point, [4.6, 0.0, 0.0])  # more than in every direction
    asked = problems(state)
    found = answer(state, "newton", asked)
    places, colours = points(state, asked, found)
    assert places - state.position == pytest.approx(force_scale(state.rig) * asked.forces)
    exact = found.study.status == tl.Status.EXACT
    assert 0 < exact.sum() < 180
    assert ((colours == rgb("#009E73")).all(axis=1) == exact).all()


def test_jumps_are_only_between_neighbours(point):
    (_, found) = compare(edits.choose(study="force in all directions")(point), lambda: True)
    assert np.isnan(found[0].jump)


def test_what_a_rig_requires_is_held_beside_each_force():
    state = edits.choose(study="force in a circle")(begin(tl.load_rig("cogiro")))
    found = answer(state, "newton", problems(state))
    assert found.now.status == tl.Status.EXACT
    assert (found.study.wrench[:, 2] > 800.0).all()  # the weight of 91 kg


def test_a_policy_that_a_solver_has_not_is_left_to_it(point):
    state = edits.choose(policy="direction")(point)
    assert answer(state, "dykstra", problems(state)).problem == ""


def test_a_solver_that_serves_no_such_rig_says_so(point):
    state = edits.choose(study="force in a circle")(begin(tl.load_rig("seven-modules")))
    assert "serves no such problem" in answer(state, "polygon", problems(state)).problem


def test_a_comparison_ends_as_soon_as_nobody_wants_it(point):
    assert compare(point, lambda: False) is None


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("name", ["kntu-planar", "ipanema-2", "body-mounted"])
def test_every_kind_of_rig_can_be_studied(name, study):
    state = edits.choose(study=study)(begin(tl.load_rig(name)))
    found = answer(state, "newton", problems(state))
    assert found.problem == ""
    assert len(found.study.status) == len(problems(state).forces)
