import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import InputError
from tensionlab.plots import plot_certified
from tests.helpers.figures import content_of, words_in

BALL = ([0.0, 0.0, 0.0], 1.0)


def prove(region):
    return tl.workspace.certify(tl.load_rig("bartels2026-validation"), region, BALL, 0.05)


def test_slices_through_the_home_say_what_is_proved():
    proved = prove([(-0.6, 0.6), (0.0, 2.3), (-0.6, 0.6)])
    figure = plot_certified(proved)
    words = "\n".join(words_in(content_of(figure)))
    for word in ("proved inside", "proved outside", "undecided", "y = 0.3 m", "x = 0 m", "ball of 1 N", "m³"):
        assert word in words, word
    scales = [np.diff(axes.transData.transform([[0.0, 0.0], [1.0, 1.0]]), axis=0) for axes in figure.axes]
    np.testing.assert_allclose(scales, scales[0] * np.ones_like(scales), rtol=1e-3)
    for axes, cut in zip(figure.axes, range(3), strict=True):
        (image,) = axes.images
        shown = np.asarray(image.get_array())
        left, right, bottom, top = image.get_extent()
        at = proved.rig.home.copy()
        across, along = [axis for axis in (0, 2, 1) if axis != cut]  # y is up
        x, y = (left + 0.3 * (right - left)), (bottom + 0.1 * (top - bottom))
        at[[across, along]] = x, y
        assert shown[int(0.1 * shown.shape[0]), int(0.3 * shown.shape[1])] == proved.at(at) + 1


def test_a_region_without_modules_has_three_slices_a_plane_one_and_a_line_none():
    assert len(plot_certified(prove([(-0.4, 0.4), (0.1, 1.6), (-0.4, 0.4)])).axes) == 3
    assert len(plot_certified(prove([(-0.6, 0.6), (0.3, 0.3), (-0.6, 0.6)])).axes) == 1
    with pytest.raises(InputError, match="a line along y"):
        plot_certified(prove([(0.0, 0.0), (0.0, 2.3), (0.0, 0.0)]))
