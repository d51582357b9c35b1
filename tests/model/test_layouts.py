from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.distance import pdist

from tensionlab.errors import RigError
from tensionlab.model.files import load_rig
from tensionlab.model.layouts import alternate_corners, box_corners, ring_plus_top

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"


@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_a_ring_is_a_regular_polygon_on_the_floor(count):
    rig = ring_plus_top(side=0.8, count=count, height=0.25, top=1.5)
    ring = rig.anchors[:-1]
    assert rig.m == count + 1
    neighbours = np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1)
    np.testing.assert_allclose(neighbours, 0.8)
    np.testing.assert_allclose(ring.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_array_equal(ring[:, 1], 0.0)
    assert rig.home.tolist() == [0.0, 0.25, 0.0]
    assert rig.anchors[-1].tolist() == [0.0, 1.75, 0.0]
    assert rig.modules[-1].name == "top"


@pytest.mark.parametrize(
    ("name", "side", "top"),
    [("bartels2026-validation", 1.0, 2.0), ("bartels2026-validation-0.3m", 0.3, 2.0), ("floor-3", 1.0, None)],
)
def test_the_published_rig_is_a_ring_plus_top(name, side, top):
    rig, layout = load_rig(RIGS / f"{name}.toml"), ring_plus_top(side, top=top)
    np.testing.assert_allclose(rig.anchors, layout.anchors, atol=1e-9)
    np.testing.assert_array_equal(rig.home, layout.home)
    np.testing.assert_array_equal(rig.limits.lower, layout.limits.lower)
    np.testing.assert_array_equal(rig.limits.upper, layout.limits.upper)


def test_box_corners_span_the_box():
    rig = box_corners([2.0, 1.0, 3.0], limits=(1.0, 9.0))
    assert rig.m == 8
    assert ConvexHull(rig.anchors).volume == pytest.approx(6.0)
    np.testing.assert_array_equal(np.ptp(rig.anchors, axis=0), [2.0, 1.0, 3.0])
    assert rig.limits.lower.tolist() == [1.0] * 8
    assert rig.limits.upper.tolist() == [9.0] * 8
    assert {m.name: m.anchor.tolist() for m in rig.modules}["x- y+ z+"] == [-1.0, 0.5, 1.5]


def test_alternate_corners_close_a_third_of_the_box():
    rig = alternate_corners([2.0, 1.0, 3.0])
    assert rig.m == 4
    assert ConvexHull(rig.anchors).volume == pytest.approx(2.0)
    # No two share an edge: on a cube all are a face diagonal apart.
    np.testing.assert_allclose(pdist(alternate_corners([1.0, 1.0, 1.0]).anchors), np.sqrt(2))


def test_a_layout_may_be_small():
    assert np.ptp(box_corners([1e-4, 2e-4, 3e-4]).anchors, axis=0).tolist() == [1e-4, 2e-4, 3e-4]
    assert np.abs(ring_plus_top(1e-4).anchors[:3]).max() < 1e-4


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ring_plus_top(1.0, count=1), "count is 1"),
        (lambda: ring_plus_top(-1.0), "side is -1.0"),
        (lambda: ring_plus_top(float("nan")), "side is nan"),
        (lambda: box_corners([1.0, 2.0]), r"size is \[1.0, 2.0\]"),
        (lambda: alternate_corners([1.0, 0.0, 2.0]), r"size is \[1.0, 0.0, 2.0\]"),
        (lambda: ring_plus_top(1.0, limits=(6.0, 0.5)), 'module "floor-1": key "lower" is 6.0'),
    ],
)
def test_impossible_layouts_are_refused(call, words):
    with pytest.raises(RigError, match=words):
        call()
