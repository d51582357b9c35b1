"""What the page shows of a state is what the public interface says of it."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.evaluation import evaluate, polytope
from tensionlab.viewer.state import begin

RIGS = ("bartels2026-validation", "seven-modules", "ipanema-2", "cogiro", "kntu-planar", "body-mounted")


@pytest.mark.parametrize("name", RIGS)
def test_tensions_and_margin_are_those_of_the_interface(name):
    rig = tl.load_rig(name)
    state = edits.set_wrench(begin(rig), 0.3 * np.arange(1.0, rig.n + 1))
    found = evaluate(state)
    structure = rig.structure_matrix(rig.home, frames=rig.at_rest)
    assert found.allocation.tensions == pytest.approx(tl.allocate(structure, state.exerted, rig.limits).tensions)
    swept = tl.sweep(rig, [rig.home], "capacity-margin", frames=rig.at_rest)
    assert found.margin == pytest.approx(float(swept["capacity-margin"].values.item()))


@pytest.mark.parametrize("name", RIGS)
def test_a_force_is_inside_the_set_if_and_only_if_it_is_rendered(name):
    rig = tl.load_rig(name)
    state = begin(rig)
    available = evaluate(state).available
    hull = ConvexHull(available.corners)
    structure = rig.structure_matrix(rig.home, frames=rig.at_rest)
    reach = np.abs(available.corners).max(axis=0)
    forces = np.random.default_rng(0).uniform(-1.3, 1.3, (200, rig.dimension)) * reach
    wrenches = np.concatenate([forces, np.zeros((200, rig.n - rig.dimension))], axis=1)
    exact = tl.allocate(structure, wrenches + state.exerted, rig.limits).status == tl.Status.EXACT
    depth = (forces @ hull.equations[:, :-1].T + hull.equations[:, -1]).max(axis=1)
    clear = np.abs(depth) > 1e-4 * reach.max()
    assert ((depth < 0) == exact)[clear].all()
    assert exact.any()
    assert not exact.all()


def test_a_set_is_closed_and_its_triangles_face_outwards():
    available = evaluate(begin(tl.load_rig("seven-modules"))).available
    a, b, c = (available.corners[available.faces[:, i]] for i in range(3))
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6
    assert volume == pytest.approx(ConvexHull(available.corners).volume)
    sides = np.unique(ConvexHull(available.corners).equations.round(6), axis=0)
    assert len(available.corners) - len(available.edges) + len(sides) == 2  # Euler


def test_a_set_without_a_volume_is_not_drawn():
    assert polytope(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]])) is None
    assert polytope(np.array([[0.0, 0.0], [1.0, 1.0], [0.5, 0.5]])) is None
    state = begin(tl.load_rig("ipanema-2"))  # no tensions exert this torque
    assert evaluate(edits.set_wrench(state, [0.0, 0.0, 0.0, 1e4, 0.0, 0.0])).available is None


def test_why_there_is_no_answer_is_told():
    state = begin(tl.load_rig("bartels2026-validation"))
    found = evaluate(edits.move_hand(state, state.anchors[3]))
    assert found.allocation is None
    assert 'module "top"' in found.problem
    found = evaluate(edits.set_fields(solver="polygon")(begin(tl.load_rig("seven-modules"))))
    assert found.allocation is None
    assert "does not support this problem" in found.problem
    assert found.margin > 0.0  # it depends on no solver
