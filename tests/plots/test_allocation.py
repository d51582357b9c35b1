import numpy as np
import pytest

import tensionlab as tl
from tensionlab.plots import plot_allocation
from tests.helpers.figures import content_of, words_in
from tests.helpers.runs import four, seven


def test_tensions_are_drawn_between_their_limits_by_status():
    rig = four()
    forces = np.array([[0.0, 1.0, 0.0], [0.0, 90.0, 0.0]])
    found = tl.allocate(rig.structure_matrix(rig.home), forces, rig.limits)
    figure = tl.plot(found, rig)
    (axes,) = figure.axes
    drawn = [line.get_xdata() for line in axes.get_lines()]
    assert [list(each) for each in drawn[:4]] == [[0.5, 6.0]] * 4
    assert sorted(float(each[0]) for each in drawn[4:]) == sorted(found.tensions.ravel())
    content = content_of(figure)
    assert {"floor-1", "tension (N)", "exact", "certified infeasible", "limits"} <= set(words_in(content))
    assert content == content_of(plot_allocation(found, rig))


def test_a_rig_with_other_cables_is_refused():
    rig = four()
    with pytest.raises(tl.errors.ShapeError, match="4 cables, and seven-modules has 7"):
        tl.plot(tl.allocate(rig.structure_matrix(rig.home), np.zeros(3), rig.limits), seven())
