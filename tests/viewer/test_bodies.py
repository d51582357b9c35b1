"""Bodies of a rig in the scene, and the cable that is nearest to one."""

from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.support.colours import GREY, RED, rgb
from tensionlab.viewer.bodies import body_mesh, draw_bodies
from tensionlab.viewer.design_scene import draw
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.state import begin, change_module

RIG = tl.load_rig("bartels2026-validation")


def volume(mesh):
    """Volume inside the triangles of a closed surface, whose faces are anticlockwise from outside."""
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def test_surfaces_have_the_volume_of_the_shapes():
    ball = tl.Body("ball", [0.1, 0.2, 0.3], radius=0.2)
    limb = tl.Body("limb", [0.0, 0.0, 0.0], [0.3, 0.0, 0.4], radius=0.1)
    box = tl.Body("box", [0.1, 0.2, 0.3], size=[0.2, 0.3, 0.4])
    assert volume(body_mesh(ball)) == pytest.approx(4 / 3 * np.pi * 0.2**3, rel=0.03)
    assert volume(body_mesh(limb)) == pytest.approx(np.pi * 0.1**2 * 0.5 + 4 / 3 * np.pi * 0.1**3, rel=0.03)
    assert volume(body_mesh(box)) == pytest.approx(0.2 * 0.3 * 0.4)


def test_the_nearest_cable_is_marked_with_its_distance_red_below_the_margin():
    for margin, colour, more in ((0.15, GREY, ""), (0.2, RED, ", margin 0.2 m")):
        head = tl.Body("head", [0.0, 1.2, -0.3], radius=0.12, margin=margin)
        far = tl.Body("far", [0.0, 1.2, -3.0], radius=0.12)
        rig = replace(RIG, bodies=(far, head))
        scene = draw(begin(rig), evaluate(begin(rig))).bodies
        assert scene.label == "top: 0.18 m from head" + more
        np.testing.assert_array_equal(scene.cable.points, [[rig.home, rig.anchors[3]]])
        assert scene.cable.colours.tolist() == [rgb(colour).tolist()]
        assert np.argwhere(scene.near).tolist() == ([[3, 1]] if more else [])
    assert not draw(begin(RIG), evaluate(begin(RIG))).bodies.label


def test_bodies_are_where_their_frames_are_and_stay_there_when_a_module_changes():
    bodies, rest = tl.person("standing", up="y", at=[0.2, -0.1, -0.9], facing=[1.0, 0.0, 1.0])
    in_hand = tl.Body("tool", [0.0, 0.1, 0.0], radius=0.02, frame="hand")
    state = begin(replace(RIG, bodies=(*bodies, in_hand), rest=(rest,)))
    scene = draw_bodies(state.rig, np.stack([state.attachments, state.anchors], 1), state.position)
    np.testing.assert_allclose(scene.poses[0][:3, 3], [0.2, -0.1, -0.9])
    np.testing.assert_allclose(scene.poses[-1][:3, 3], RIG.home)
    assert scene.points[:, 1].max() == pytest.approx(1.75 - 0.1, abs=0.01)
    np.testing.assert_array_equal(change_module(state, "top", upper=5.0).rig.rest[0].position, rest.position)
