"""Where anchors snap to on the surfaces of a space."""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_page import dragged
from tensionlab.viewer.design_scene import Grab
from tensionlab.viewer.state import begin, nearest_on_surfaces, outlines
from tensionlab.workspace.layout.task import load_task

# From -2 to 2 in x and z, from 0 to 2 in y.
ROOM = tl.workspace.Space(tl.workspace.room([4.0, 2.0, 4.0]), counts=(4,))


@pytest.mark.parametrize(
    ("place", "policy"),
    [([1.8, 1.0, 0.0], [2.0, 1.0, 0.0]), ([0.0, 0.3, 0.0], [0.0, 0.0, 0.0]), ([5.0, 5.0, 0.5], [2.0, 2.0, 0.5])],
)
def test_a_place_snaps_to_the_nearest_wall(place, policy):
    assert nearest_on_surfaces(ROOM, np.array(place)) == pytest.approx(policy)


def test_rails_and_boxes_hold_modules_too():
    rail = tl.workspace.Surface("rail", [-1.0, 2.0, 0.0], [[2.0, 0.0, 0.0]])
    space = tl.workspace.Space((rail,), counts=(1,))
    assert nearest_on_surfaces(space, np.array([0.3, 0.0, 0.4])) == pytest.approx([0.3, 2.0, 0.0])
    assert nearest_on_surfaces(space, np.array([3.0, 0.0, 0.4])) == pytest.approx([1.0, 2.0, 0.0])
    assert outlines(space).tolist() == [[[-1.0, 2.0, 0.0], [1.0, 2.0, 0.0]]]


def test_a_room_has_four_edges_a_wall():
    lines = outlines(ROOM)
    assert lines.shape == (24, 2, 3)
    assert {tuple(np.abs(line[1] - line[0])) for line in lines} == {
        (4.0, 0.0, 0.0),
        (0.0, 2.0, 0.0),
        (0.0, 0.0, 4.0),
    }


def test_an_anchor_that_is_dragged_stays_on_the_walls():
    state = edits.set_fields(task=load_task("four-in-a-room"))(begin(tl.load_rig("seven-modules")))
    name = state.rig.modules[0].name
    for place in np.random.default_rng(0).uniform(-3.0, 3.0, (20, 3)):
        for eye in (None, np.array([0.0, 1.2, 12.0])):
            anchor = edits.find(dragged(state, Grab(name, "update", place, eye)), name).anchor
            sides = np.abs(anchor - [0.0, 1.25, 0.0]) - [2.0, 1.25, 2.0]
            assert sides.max() == pytest.approx(0.0, abs=1e-4)
