"""Edits of the design page's state and their undo: pure functions, without a browser."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_page import dragged
from tensionlab.viewer.design_scene import Grab
from tensionlab.viewer.history import History
from tensionlab.viewer.state import HAND, begin, nearest_on_surfaces
from tensionlab.workspace.layout.task import load_task


def test_a_moved_anchor_leaves_the_others_and_the_old_state_alone(point):
    moved = edits.move_anchor(point, "floor-2", [-0.4, 0.1, 0.6])
    assert moved.anchors[1] == pytest.approx([-0.4, 0.1, 0.6])
    assert (moved.anchors[[0, 2, 3]] == point.anchors[[0, 2, 3]]).all()
    assert (point.rig.modules[1].anchor == tl.load_rig("bartels2026-validation").modules[1].anchor).all()
    assert edits.move_anchor(point, "top", point.anchors[3]) is point  # and so the workspace stays


def test_dragged_points_snap_to_the_grid(point):
    state = edits.set_fields(grid_m=0.25)(point)
    assert edits.move_anchor(state, "top", [0.1, 2.2, -0.13]).anchors[3] == pytest.approx([0.0, 2.25, -0.25])
    assert edits.move_hand(state, [0.13, 0.3, 0.0]).position == pytest.approx([0.25, 0.25, 0.0])


def test_an_anchor_on_a_turned_body_is_put_where_the_world_has_it():
    rig = tl.load_rig("body-mounted")
    quarter = tl.RestPose(rig.frames[0], np.array([0.0, 0.9, 0.0]), np.array([0.0, np.pi / 2, 0.0]))
    others = tuple(at_rest for at_rest in rig.rest if at_rest.name != quarter.name)
    state = begin(replace(rig, rest=(*others, quarter)))
    rider = next(module.name for module in rig.modules if module.frame == quarter.name)
    moved = edits.move_anchor(state, rider, [0.3, 1.0, -0.2])
    assert moved.anchors[moved.names.index(rider)] == pytest.approx([0.3, 1.0, -0.2])
    assert edits.find(moved, rider).anchor == pytest.approx([0.2, 0.1, 0.3])  # turned by a quarter


def test_a_module_that_changes_its_frame_stays_where_it_is(point):
    on_hip = edits.move_body(edits.set_frame(point, "top", "hip"), "top", [0.0, 1.0, 0.0])
    assert on_hip.anchors[3] == pytest.approx(point.anchors[3] + [0.0, 1.0, 0.0])  # it went with the body
    back = edits.set_frame(on_hip, "top", "world")
    assert back.anchors[3] == pytest.approx(on_hip.anchors[3])
    assert (back.rig.frames, back.rig.rest) == ((), ())  # no rest pose of a frame that carries nothing


def test_modules_are_added_above_the_hand_renamed_and_removed_down_to_the_last(point):
    twice = edits.add_module(edits.add_module(point))
    assert list(twice.names) == [*point.names, "module 1", "module 2"]
    assert twice.rig.modules[4].upper == point.rig.modules[0].upper
    assert twice.anchors[4][1] > twice.position[1]
    assert twice.selected == "module 2"
    renamed = edits.rename(twice, "module 2", "ceiling")
    assert renamed.selected == "ceiling"
    for name in renamed.names[1:]:
        renamed = edits.remove_module(edits.set_fields(selected=name)(renamed), name)
    assert (renamed.names, renamed.selected) == (("floor-1",), "")
    with pytest.raises(tl.errors.RigError, match="only module"):
        edits.remove_module(renamed, "floor-1")


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda state: edits.rename(state, "top", "floor-1"), "used by modules"),
        (lambda state: edits.change_module(state, "top", lower=9.0, upper=1.0), 'above "upper"'),
        (lambda state: edits.move_anchor(state, "roof", [0.0] * 3), 'no module "roof"; it has floor-1, floor-2'),
    ],
)
def test_edits_to_impossible_rigs_are_refused(point, edit, message):
    with pytest.raises(tl.errors.RigError, match=message):
        edit(point)


def test_attachments_turn_with_the_platform():
    platform = begin(tl.load_rig("ipanema-2"))
    turned = edits.turn_platform(platform, tl.workspace.roll_pitch_yaw(0.0, 0.0, np.pi / 2)[0])
    arms, old = turned.attachments - turned.position, platform.attachments - platform.position
    assert arms == pytest.approx(np.stack([-old[:, 1], old[:, 0], old[:, 2]], axis=1))


def test_cables_exert_the_required_wrench_in_addition_to_the_desired_one():
    rig = tl.load_rig("cogiro")
    lifting = replace(rig, required=tl.Requirement(gravity=True))
    state = edits.set_wrench(begin(lifting), [0.0, 0.0, 10.0, 0.0, 0.0, 0.0])
    assert state.exerted[2] == pytest.approx(10.0 + 9.81 * rig.platform.mass)


def test_a_drag_in_the_plane_stays_in_it():
    state = begin(tl.load_rig("kntu-planar"))
    place, eye = np.array([0.3, 0.2, 0.5]), np.array([0.0, 0.0, 5.0])
    moved = dragged(state, Grab(HAND, "update", place, eye))
    assert moved.position == pytest.approx([1 / 3, 2 / 9], abs=1e-4)
    level = np.array([1.0, 0.0, 5.0])  # on a ray that never meets it
    assert dragged(state, Grab(HAND, "update", level, eye)).position.tolist() == [1.0, 0.0]


def undone(history):
    history.undo()
    return history.present


def test_undo_and_redo_go_through_the_steps_of_which_a_drag_is_one(point):
    history, drag = History(point), object()
    for height in np.linspace(0.3, 0.8, 6):
        history.record(edits.move_hand(history.present, [0.0, height, 0.0]), drag)
    history.record(edits.set_wrench(history.present, [1.0, 0.0, 0.0]), object())
    assert undone(history).wrench.tolist() == [0.0, 0.0, 0.0]
    assert undone(history).position.tolist() == [0.0, 0.3, 0.0]
    assert undone(history).position.tolist() == [0.0, 0.3, 0.0]  # there is nothing more
    history.redo()
    assert history.present.position.tolist() == [0.0, 0.8, 0.0]
    history.record(edits.move_hand(history.present, [0.1, 0.4, 0.0]))
    history.redo()
    assert history.present.position.tolist() == [0.1, 0.4, 0.0]


def test_undo_leaves_the_view_of_the_rig_alone(point):
    history = History(point)
    history.record(edits.add_module(point))
    history.record(edits.set_fields(metric="tension-factor")(history.present))
    before = undone(history)
    assert (before.metric, before.rig.m) == ("tension-factor", 4)
    assert before.selected == ""  # the selected module is gone


# From -2 to 2 in x and z, from 0 to 2 in y.
ROOM = tl.workspace.Space(tl.workspace.room([4.0, 2.0, 4.0]), counts=(4,))
RAIL = tl.workspace.Space((tl.workspace.Surface("rail", [-1.0, 2.0, 0.0], [[2.0, 0.0, 0.0]]),), counts=(1,))


@pytest.mark.parametrize(
    ("space", "place", "nearest"),
    [
        (ROOM, [1.8, 1.0, 0.0], [2.0, 1.0, 0.0]),
        (ROOM, [5.0, 5.0, 0.5], [2.0, 2.0, 0.5]),
        (RAIL, [0.3, 0.0, 0.4], [0.3, 2.0, 0.0]),
        (RAIL, [3.0, 0.0, 0.4], [1.0, 2.0, 0.0]),
    ],
)
def test_a_place_snaps_to_the_nearest_point_of_the_surfaces(space, place, nearest):
    assert nearest_on_surfaces(space, np.array(place)) == pytest.approx(nearest)


def test_a_dragged_anchor_stays_on_the_walls():
    state = edits.set_fields(task=load_task("four-in-a-room"))(begin(tl.load_rig("seven-modules")))
    name = state.rig.modules[0].name
    for place in np.random.default_rng(0).uniform(-3.0, 3.0, (20, 3)):
        anchor = edits.find(dragged(state, Grab(name, "update", place)), name).anchor
        sides = np.abs(anchor - [0.0, 1.25, 0.0]) - [2.0, 1.25, 2.0]
        assert sides.max() == pytest.approx(0.0, abs=1e-4)
