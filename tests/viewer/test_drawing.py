"""Nodes of the scene, as viser is asked for them."""

from unittest.mock import MagicMock

import numpy as np

import tensionlab as tl
from tensionlab.support.colours import rgb
from tensionlab.viewer.drawing import ARROW_SHARES, Drawing, linear
from tensionlab.viewer.instant import ARROW_COLOURS
from tensionlab.viewer.run_drawing import RunDrawing
from tensionlab.viewer.scene import ARROWS, size
from tensionlab.viewer.state import begin

RIG = tl.load_rig("bartels2026-validation")


def arrows(server):
    """Colours and sizes of the arrows that viser was asked for, by name."""
    return {
        call.args[0].removeprefix("/arrows/"): (
            tuple(call.args[2]),
            {name: call.kwargs[name] for name in ARROW_SHARES},
        )
        for call in server.scene.add_arrows.call_args_list
    }


def test_arrows_have_the_same_colours_and_sizes_on_the_page_of_a_rig_and_on_that_of_a_run():
    designed, ran = MagicMock(), MagicMock()
    Drawing(designed, begin(RIG), print, print)
    RunDrawing(ran, RIG, MagicMock(anchors=RIG.anchors, hand=RIG.home))
    sizes = {name: share * size(RIG) for name, share in ARROW_SHARES.items()}
    for server, colours in ((designed, ARROWS), (ran, ARROW_COLOURS)):
        assert arrows(server) == {name: (tuple(linear(rgb(each))), sizes) for name, each in colours.items()}


def test_colours_are_linear_where_viser_takes_them_so():
    assert linear(np.array([0, 10, 128, 255], np.uint8)).tolist() == [0, 1, 55, 255]
