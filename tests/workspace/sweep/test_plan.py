import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import SweepError
from tensionlab.workspace import vary

RIG = tl.ring_plus_top(1.0)


def values(configurations, name):
    return configurations.labels()[name][1].tolist()


def units(configurations, name):
    return configurations.labels()[name][2]["units"]


def test_every_combination_of_layout_parameters_is_a_rig():
    rigs = vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4, 8], height=0.2)
    assert rigs.dims == ("side", "count")
    assert rigs.shape == (2, 3)
    for i, side in enumerate([0.5, 1.0]):
        for j, count in enumerate([3, 4, 8]):
            assert rigs.rig([i, j]) == tl.ring_plus_top(side, count, 0.2)
    assert values(rigs, "side") == [0.5, 1.0]
    assert units(rigs, "side") == "m"
    assert values(rigs, "count") == [3, 4, 8]
    assert units(rigs, "count") == "1"


def test_points_are_labelled_by_number_and_coordinates():
    rigs = vary(tl.box_corners, size=[[1.0, 2.0, 3.0], [2.0, 2.0, 2.0]])
    assert rigs.rig([1]) == tl.box_corners([2.0, 2.0, 2.0])
    assert values(rigs, "size") == [0, 1]
    assert values(rigs, "size_z") == [3.0, 2.0]
    assert units(rigs, "size_z") == "m"


def test_limits_apply_to_all_modules_of_all_rigs():
    rigs = vary([RIG, tl.box_corners([1, 1, 1])], limits=[(0.5, 6), (1, 12)])
    assert rigs.dims == ("rig", "limits")
    assert rigs.rig([1, 1]).limits.lower.tolist() == [1.0] * 8
    assert rigs.rig([1, 1]).limits.upper.tolist() == [12.0] * 8
    assert values(rigs, "limits_upper") == [6.0, 12.0]
    assert units(rigs, "limits_upper") == "N"


def test_a_layout_of_ones_own_has_parameters_too():
    def two(reach, style):
        modules = [tl.Module(f"{style}-{s}", [s * reach, 0.0], 0.0, 1.0) for s in (-1, 1)]
        return tl.Rig("two", "planar-point", tuple(modules), np.zeros(2))

    rigs = vary(two, reach=[1.0, 2.0], style=["a", "b"])
    assert rigs.rig([1, 1]).modules[1].name == "b-1"
    assert values(rigs, "style") == ["a", "b"]
    assert units(rigs, "reach") == "SI"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: vary([]), "rigs is empty"),
        (lambda: vary([RIG, RIG]), 'two rigs are called "ring-3-plus-top"'),
        (lambda: vary(RIG, side=[1.0]), "'side' is the parameter of a layout"),
        (lambda: vary(tl.ring_plus_top, side=1.0, sides=[1.0]), "'sides'; its parameters are side,"),
        (lambda: vary(tl.ring_plus_top, count=[3]), "ring_plus_top: missing a required argument: 'side'"),
        (lambda: vary(tl.ring_plus_top, side=[]), "side holds no values"),
        (lambda: vary(tl.ring_plus_top, side=[{}]), "side is .*give numbers"),
        (lambda: vary(RIG, limits=(0.5, 6)), "limits is .*pairs"),
    ],
)
def test_odd_variations_are_refused(call, words):
    with pytest.raises(SweepError, match=words):
        call()
