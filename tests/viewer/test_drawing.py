"""Nodes of the scene, as viser is asked for them."""

from unittest.mock import MagicMock

import numpy as np

import tensionlab as tl
from tensionlab.support.colours import FORCE_COLOURS, rgb
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_scene import ARROWS, DesignDrawing, draw
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.scene import RigDrawing, linear
from tensionlab.viewer.state import begin

RIG = tl.load_rig("bartels2026-validation")


def test_arrows_have_the_same_colours_on_the_page_of_a_rig_and_on_that_of_a_run():
    for colours in (ARROWS, FORCE_COLOURS):
        server = MagicMock()
        RigDrawing(server, colours)
        added = {call.args[0]: call.args[2].tolist() for call in server.scene.add_arrows.call_args_list}
        assert added == {f"/arrows/{name}": linear(rgb(colour)).tolist() for name, colour in colours.items()}


def test_colours_are_linear_where_viser_takes_them_so():
    assert linear(np.array([0, 10, 128, 255], np.uint8)).tolist() == [0, 1, 55, 255]


def test_modules_that_are_added_and_removed_have_a_ball_each():
    server, balls = MagicMock(), []
    server.scene.add_icosphere = lambda *name, **how: balls.append(MagicMock()) or balls[-1]
    state = begin(RIG)
    drawing = DesignDrawing(server, state, print, print)
    others = len(balls)  # those of the hand and of the desired force
    for shown in (state, edits.add_module(state), edits.remove_module(state, "top")):
        drawing.show(draw(shown, evaluate(shown)), shown)
        there = [ball for ball in balls[others:] if not ball.remove.called]
        assert [ball.position.tolist() for ball in there] == shown.anchors.tolist()
