"""What is drawn of a state: arrays, and nodes as viser is asked for them."""

from unittest.mock import MagicMock

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.support.colours import rgb
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_scene import DesignDrawing, draw, tension_colours
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.scene import FIELD_OF_VIEW_RAD, bounds, camera_pose, force_scale
from tensionlab.viewer.state import begin, opening


def drawn(state):
    return draw(state, evaluate(state))


def test_a_rig_in_the_plane_lies_in_it():
    scene = drawn(begin(tl.load_rig("kntu-planar")))
    assert scene.rig.cables.points.shape == (4, 2, 3)
    for part in (scene.rig.cables.points, scene.rig.anchors, scene.available.vertices, scene.edges.points):
        assert not part[..., 2].any()


def test_colours_and_labels_tell_where_a_tension_is_between_its_limits(point):
    state = edits.set_wrench(point, [1.0, 0.5, 1.0])  # floor-3 is at its lower limit
    assert tension_colours(point.rig, evaluate(state))[2].tolist() == rgb("#0072B2").tolist()
    assert drawn(state).rig.labels[2:] == ("floor-3 · 0.50 N", "top · 2.61 N")
    full = evaluate(edits.set_wrench(point, [0.0, 50.0, 0.0]))
    assert tension_colours(point.rig, full)[3].tolist() == rgb("#D55E00").tolist()


def test_the_desired_force_ends_at_its_tip_to_scale(point):
    scene = drawn(edits.set_wrench(point, [4.0, 0.0, 0.0]))
    assert scene.tip - scene.rig.hand == pytest.approx([4.0 * force_scale(point.rig), 0.0, 0.0])
    assert scene.rig.arrows["desired"][1] == pytest.approx(scene.tip)
    assert set(scene.rig.arrows) == {"desired"}  # it is rendered
    nothing = drawn(point)
    assert np.linalg.norm(nothing.tip - nothing.rig.hand) > 0.05  # it can be grabbed next to the hand


def test_an_infeasible_force_has_its_certificate(point):
    state = edits.set_wrench(point, [20.0, 0.0, 0.0])
    scene, found = drawn(state), evaluate(state)
    scale = force_scale(point.rig)
    rendered, error, certificate = (scene.rig.arrows[name] for name in ("rendered", "error", "certificate"))
    assert rendered[1] - scene.rig.hand == pytest.approx(scale * found.allocation.wrench)
    assert error[1] == pytest.approx(scene.tip)
    start, along = certificate[0], certificate[1] - certificate[0]
    along = along / np.linalg.norm(along)
    # The plane has all available forces on one side, touches them, and has the desired one on the other.
    heights = (scene.available.vertices - start) @ along
    assert heights.max() == pytest.approx(0.0, abs=1e-9)
    assert (scene.tip - start) @ along > 0.0
    assert (scene.plane.vertices - start) @ along == pytest.approx(np.zeros(4), abs=1e-9)


def test_the_certificate_of_a_platform_is_one_at_its_torque():
    state = edits.set_wrench(begin(tl.load_rig("ipanema-2")), [0.0, 500.0, 0.0, 3.0, 0.0, 0.0])
    scene = drawn(state)
    start, end = scene.rig.arrows["certificate"]
    assert ((scene.available.vertices - start) @ (end - start)).max() <= 1e-6
    assert (scene.tip - start) @ (end - start) > 0.0


def test_another_rig_of_the_same_dimension_is_drawn_too(point):
    scene = drawn(edits.set_fields(ghost=tl.load_rig("seven-modules"))(point))
    assert len(scene.ghost.points) == 7
    planar = edits.set_fields(ghost=tl.load_rig("kntu-planar"))(point)
    assert len(drawn(planar).ghost.points) == 0


def test_a_hand_at_an_anchor_is_drawn_without_tensions(point):
    scene = drawn(edits.move_hand(point, point.anchors[3]))
    assert scene.rig.labels[3] == "top"
    assert scene.available is None
    assert scene.rig.cables.colours[0].tolist() == rgb("#777777").tolist()


@pytest.mark.parametrize("name", tl.datasets.names("rigs"))
def test_every_rig_is_drawn(name):
    state = begin(tl.load_rig(name.removeprefix("rigs/")))
    wrench = np.where(np.arange(state.rig.n) < state.rig.dimension, 3.0 * state.rig.limits.upper.max(), 0.0)
    for changed in (state, edits.set_wrench(state, wrench)):
        scene = drawn(changed)
        assert scene.rig.cables.points.reshape(-1, 3)[-1] == pytest.approx(scene.rig.anchors[-1])
        assert np.isfinite(scene.rig.cables.points).all()
        assert len(scene.rig.labels) == state.rig.m


def test_modules_that_are_added_and_removed_have_a_ball_each():
    server, balls = MagicMock(), []
    server.scene.add_icosphere = lambda *name, **how: balls.append(MagicMock()) or balls[-1]
    state = begin(tl.load_rig("bartels2026-validation"))
    drawing = DesignDrawing(server, state, print, print)
    others = len(balls)  # those of the hand and of the desired force
    for shown in (state, edits.add_module(state), edits.remove_module(state, "top")):
        drawing.show(draw(shown, evaluate(shown)), shown)
        there = [ball for ball in balls[others:] if not ball.remove.called]
        assert [ball.position.tolist() for ball in there] == shown.anchors.tolist()


@pytest.mark.parametrize("name", ["bartels2026-validation", "cogiro", "kntu-planar", "seven-modules"])
def test_a_page_opens_on_a_feasible_force_across_the_view(name):
    state = opening(tl.load_rig(name))
    found, d = evaluate(state), state.rig.dimension
    force = state.wrench[:d]
    assert found.allocation.exact
    assert np.linalg.norm(state.wrench) == pytest.approx(found.margin / 2, rel=0.05)
    position, look_at, _ = camera_pose(state.rig)
    away = (position - look_at)[:d]
    assert abs(away @ force) < 0.6 * np.linalg.norm(position - look_at) * np.linalg.norm(force)
    assert state.show_workspace


def test_a_rig_without_a_margin_opens_without_a_force():
    assert not opening(tl.load_rig("floor-3")).wrench.any()


@pytest.mark.parametrize("name", ["bartels2026-validation", "cogiro", "kntu-planar"])
def test_a_phone_shows_the_whole_rig_above_its_panel(name):
    rig, covered, aspect = tl.load_rig(name), 0.45, 390 / 844
    position, look_at, up = camera_pose(rig, covered=covered, aspect=aspect)
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    corners = np.array(np.meshgrid(*np.transpose(bounds(rig)))).reshape(rig.dimension, -1).T
    points = np.pad(corners, ((0, 0), (0, 3 - rig.dimension))) - position
    across, upwards = (points @ axis / (points @ forward) for axis in (right, np.cross(right, forward)))
    half = np.tan(FIELD_OF_VIEW_RAD / 2)
    assert (abs(across) <= half * aspect).all()
    assert (upwards <= half).all()
    assert (upwards >= half * (2 * covered - 1)).all()
