"""What a rig accepts and refuses, built in Python and asked for poses."""

import dataclasses
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import RigError, ShapeError
from tensionlab.model.files import load_rig
from tensionlab.model.layouts import ring_plus_top
from tensionlab.model.module import MAX_LENGTH, MAX_MASS, MAX_TENSION, Module, Platform
from tensionlab.model.pose import CoordinateFrame
from tensionlab.model.rig import Rig

POINT = ring_plus_top(1.0)
BAR = Rig(
    name="bar",
    kind="planar",
    modules=[
        Module("left", [-1.0, 0.0], 0.0, 9.0, attachment=[-0.1, 0.0]),
        Module("right", [1.0, 0.0], 0.0, 9.0),
    ],
    home=[0.0, 0.0],
)
WORN = Rig(
    name="worn",
    kind="point",
    modules=[
        Module("wall", [1.0, 0.0, 0.0], 0.5, 6.0),
        Module("belt", [0.0, 0.1, 0.0], 0.5, 6.0, frame="hip"),
    ],
    home=[0.0, 1.0, 0.0],
)
BOX = Rig(
    name="box",
    kind="platform",
    modules=[Module("only", [0.0, 0.0, 2.0], 0.5, 6.0, attachment=[0.1, 0.0, 0.0])],
    home=[0.0, 0.0, 1.0],
)


def make(**change):
    one = {"name": "a", "anchor": [0.0, 0.0, 1.0], "lower": 0.5, "upper": 6.0}
    return Rig(name="r", kind="point", modules=[Module(**{**one, **change})], home=[0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"lower": -0.1}, "lower"),
        ({"lower": 7.0}, "lower"),
        ({"lower": float("nan")}, "lower"),
        ({"upper": float("inf")}, "upper"),
        ({"upper": 1.001 * MAX_TENSION}, "upper"),
        ({"anchor": [0.0, 1.001 * MAX_LENGTH, 0.0]}, "anchor"),
        ({"anchor": [0.0, 1.0]}, "anchor"),
        ({"anchor": [0.0, 1.0, float("nan")]}, "anchor"),
        ({"anchor": "here"}, "anchor"),
        ({"attachment": [0.0, 0.1, 0.0]}, "attachment"),
        ({"attachment": [0.0, 0.1]}, "attachment"),
        ({"frame": ""}, "frame"),
        ({"brake": 0.0}, "brake"),
        ({"newton_per_ampere": -3.0}, "newton_per_ampere"),
        ({"spool_radius": float("nan")}, "spool_radius"),
        ({"spool_radius": 1.001 * MAX_LENGTH}, "spool_radius"),
        ({"friction_coulomb": -0.1}, "friction_coulomb"),
        ({"vibration_gain": []}, "vibration_gain"),
        ({"vibration_gain": [[20.0, 1.2], [40.0]]}, "vibration_gain"),
        ({"vibration_gain": [[40.0, 1.2], [20.0, 1.0]]}, "vibration_gain"),
        ({"vibration_gain": [[20.0, 0.0]]}, "vibration_gain"),
    ],
)
def test_a_bad_module_is_refused_by_name_and_key(change, key):
    make(spool_radius=1e-4)
    with pytest.raises(RigError, match=rf'module "a": key "{key}"'):
        make(**change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"name": ""}, 'key "name" is empty'),
        ({"kind": "spatial"}, "key \"kind\" is 'spatial'; give one of planar-point, point, planar, platform"),
        ({"modules": ()}, 'key "modules" is empty'),
        ({"home": [0.0, 0.3]}, 'key "home" has 2 coordinates; a point rig needs 3'),
        ({"home": [0.0, 0.3, np.nan]}, 'key "home"'),
        (
            {"modules": POINT.modules + POINT.modules[1:2]},
            'module "floor-2": key "name" is used by modules 2 and 5',
        ),
        ({"platform": Platform(1.0, com=[0.0, 0.0, 0.1])}, r'\[platform\]: key "com"'),
        ({"platform": Platform(1.0, inertia=np.eye(3))}, r'\[platform\]: key "inertia"'),
    ],
)
def test_a_bad_rig_is_refused_by_key(change, words):
    with pytest.raises(RigError, match=words):
        dataclasses.replace(POINT, **change)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"mass": 0.0}, "mass"),
        ({"mass": float("nan")}, "mass"),
        ({"mass": 1.001 * MAX_MASS}, "mass"),
        ({"mass": 1.0, "com": [0.0, float("inf")]}, "com"),
        ({"mass": 1.0, "inertia": [[1.0, 0.5], [0.0, 1.0]]}, "inertia"),
        ({"mass": 1.0, "inertia": [[1.0, 2.0], [2.0, 1.0]]}, "inertia"),
        ({"mass": 1.0, "inertia": [1.0, 2.0]}, "inertia"),
        ({"mass": 1.0, "inertia": [[1.001 * MAX_MASS * MAX_LENGTH**2]]}, "inertia"),
    ],
)
def test_a_bad_platform_is_refused_by_key(values, key):
    Platform(1e-4, inertia=[[1e-7]])
    with pytest.raises(RigError, match=rf'\[platform\]: key "{key}"'):
        Platform(**values)


def test_parallel_cables_are_legal():
    twins = [Module(name, [0.0, 0.0, 1.0], 0.5, 6.0) for name in ("left", "right")]
    W = Rig(name="twins", kind="point", modules=twins, home=[0.0, 0.0, 0.0]).structure_matrix([0.0, 0.0, 0.0])
    np.testing.assert_array_equal(W, [[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]])


def test_a_rig_cannot_be_changed_and_is_compared_by_its_numbers():
    assert ring_plus_top(1.0) == POINT
    assert ring_plus_top(1.1) != POINT
    assert POINT != "ring"
    with pytest.raises(AttributeError):
        POINT.name = "other"
    for array in (POINT.home, POINT.anchors, POINT.attachments, POINT.modules[0].anchor):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_a_lever_by_hand():
    """A cable that pulls up at an arm along x turns about -y; after a quarter turn, along y, about x."""
    straight = BOX.structure_matrix([-0.1, 0.0, 1.0])
    np.testing.assert_allclose(straight[:, 0], [0, 0, 1, 0, -0.1, 0], atol=1e-15)
    quarter = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    turned = BOX.structure_matrix([0.0, -0.1, 1.0], quarter)
    np.testing.assert_allclose(turned[:, 0], [0, 0, 1, 0.1, 0, 0], atol=1e-15)
    # Pulled to the left at a point below the centre: clockwise.
    np.testing.assert_allclose(BAR.structure_matrix([0.0, 0.0], np.pi / 2)[2, 0], -0.1 / np.hypot(1, 0.1))


def test_everything_broadcasts():
    positions = np.full((5, 1, 3), 0.5)
    hips = np.random.default_rng(0).normal(size=(4, 3))
    W = WORN.structure_matrix(positions, frames={"hip": CoordinateFrame(hips)})
    assert W.shape == (5, 4, 3, 2)
    np.testing.assert_array_equal(W[3, 2], WORN.structure_matrix(positions[3, 0], frames={"hip": (hips[2], None)}))
    assert BAR.structure_matrix(np.zeros((7, 1, 2)), np.linspace(0, 1, 3)).shape == (7, 3, 3, 2)
    assert BAR.lengths([0.0, 0.0], np.zeros(6)).shape == (6, 2)
    assert POINT.cables(np.full((0, 3), 0.1)).directions.shape == (0, 4, 3)


def test_an_attachment_on_its_anchor_is_named():
    with pytest.raises(RigError, match=r'rig "ring-3-plus-top": module "top" \(index 3\).*at pose \[1\]'):
        POINT.structure_matrix([[0.0, 0.5, 0.0], POINT.anchors[3]])
    with pytest.raises(RigError, match=r'module "top" \(index 3\): the attachment lies on the anchor, so'):
        POINT.lengths(POINT.anchors[3])
    near = POINT.anchors[3] - [0.0, 5e-4, 0.0]  # the shortest cables have a direction
    np.testing.assert_allclose(POINT.cables(near).directions[3], [0.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (
            lambda: POINT.lengths([0.0, 1.0]),
            ShapeError,
            r"position has shape \(2,\); its last axis must hold 3",
        ),
        (lambda: POINT.lengths(0.0), ShapeError, "position has shape"),
        (lambda: POINT.lengths("home"), ShapeError, "position is not an array of numbers"),
        (
            lambda: POINT.lengths([[0.0, 1.0, 0.0], [0.0, np.nan, 0.0]]),
            ShapeError,
            r"position\[1, 1\] is nan",
        ),
        (lambda: POINT.lengths(POINT.home, np.eye(3)), ShapeError, "cannot turn"),
        (lambda: BOX.lengths(BOX.home, [0.1, 0.0, 0.0]), ShapeError, r"rotation has shape \(3,\)"),
        (lambda: BOX.lengths(BOX.home, np.eye(3) * 1.0001), ShapeError, "rotation is not a rotation"),
        (
            lambda: BOX.lengths(BOX.home, [np.eye(3), -np.eye(3)]),
            ShapeError,
            r"rotation\[1\] is not a rotation",
        ),
        (lambda: BAR.lengths(BAR.home, np.nan), ShapeError, "rotation is nan"),
        (lambda: BAR.lengths(np.zeros((2, 2)), np.zeros(3)), ShapeError, r"position \(2,\).*rotation \(3,\)"),
        (lambda: WORN.lengths(WORN.home), RigError, r'module "belt" \(index 1\) is attached to the frame "hip"'),
        (
            lambda: POINT.lengths(POINT.home, frames={"hip": ([0.0, 0.0, 0.0], None)}),
            RigError,
            'frame "hip".*none',
        ),
        (
            lambda: WORN.lengths(WORN.home, frames={"hip": ([0, 0, 0], None), "hop": ([0, 0, 0], None)}),
            RigError,
            'no module or body is attached to the frame "hop"; the body frames of this rig are: hip',
        ),
        (
            lambda: WORN.lengths(WORN.home, frames={"hip": ([0.0, np.inf, 0.0], None)}),
            ShapeError,
            r'frame "hip" position\[1\] is inf',
        ),
        (
            lambda: WORN.lengths(WORN.home, frames={"hip": ([0.0, 0.0, 0.0], np.zeros((3, 3)))}),
            ShapeError,
            'frame "hip" rotation is not a rotation',
        ),
        (
            lambda: WORN.lengths(WORN.home, frames={"hip": (np.zeros((2, 3)), np.stack([np.eye(3)] * 3))}),
            ShapeError,
            r'frame "hip" position \(2,\), frame "hip" rotation \(3,\)',
        ),
        (
            lambda: WORN.lengths(np.zeros((2, 3)), frames={"hip": (np.ones((3, 3)), None)}),
            ShapeError,
            r"position \(2,\), frames \(3,\)",
        ),
    ],
)
def test_bad_poses_are_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_a_rig_that_does_not_say_which_axis_is_up_has_no_weight():
    silent = replace(BOX, up=None, description="Z is up.")
    assert silent.vertical == "y"
    with pytest.raises(RigError, match=r'rig ".*": key "up" is missing; give the axis that points up'):
        _ = silent.upward
    with pytest.raises(RigError, match=r'key "up" is \'w\'; give the axis that points up: x, y, z, -x, -y, -z'):
        replace(BOX, up="w")


def test_a_frame_may_be_a_position_alone() -> None:
    rig = load_rig(Path(__file__).parents[2] / "datasets/rigs/body-mounted.toml")
    shoulder, hip = [0.2, 1.4, 0.0], [-0.15, 0.95, 0.0]
    expected = rig.structure_matrix(
        rig.home, frames={"shoulder": CoordinateFrame(shoulder), "hip": (hip, np.eye(3))}
    )
    for given in (hip, tuple(hip), np.array(hip)):
        W = rig.structure_matrix(rig.home, frames={"shoulder": shoulder, "hip": given})
        np.testing.assert_array_equal(W, expected)
    with pytest.raises(ShapeError, match='frame "hip" position'):
        rig.structure_matrix(rig.home, frames={"shoulder": shoulder, "hip": np.eye(4)})


def test_a_rig_allocates_what_is_desired_beside_what_it_requires():
    rig = tl.load_rig("cogiro")
    rig = replace(rig, required=tl.Requirement(gravity=True))
    position = rig.home + np.array([0.1, 0.0, 0.2])
    lift = np.array([[0.0, 0.0, 100.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1e9, 0.0, 0.0, 0.0]])
    found = rig.allocate(lift, position)
    structure = rig.structure_matrix(position)
    np.testing.assert_allclose(structure @ found.tensions[0], lift[0] - rig.gravity(), atol=1e-6)
    assert found.exact.tolist() == [True, False]
    assert found.infeasible.tolist() == [False, True]
    np.testing.assert_array_equal(
        found.tensions, tl.allocate(structure, lift - rig.gravity(), rig.limits).tensions
    )
    row = found.to_pandas().loc[0]
    assert [row[f"position_{i}"] for i in range(3)] == list(position)
    assert row["desired_2"] == lift[0, 2] - rig.gravity()[2]
    assert row[f"tension_{rig.modules[3].name}"] == found.tensions[0, 3]


def test_a_rig_allocates_at_home_with_its_frames_at_rest():
    rig = tl.load_rig("body-mounted")
    found = rig.allocate([0.0, 0.5, 0.0])
    structure = rig.structure_matrix(rig.home, frames=rig.at_rest)
    np.testing.assert_array_equal(found.tensions, tl.allocate(structure, [0.0, 0.5, 0.0], rig.limits).tensions)
    with pytest.raises(ShapeError, match="wrench"):
        rig.allocate([0.0, 1.0])


def test_a_table_of_a_rig_says_what_platform_it_has():
    held = replace(BOX, platform=Platform(2.5))
    assert ", platform of 2.5 kg, home" in held._repr_html_()
    assert "platform of" not in BOX._repr_html_()
    assert "of a desk" in replace(BOX, description="of a desk")._repr_html_()
    assert repr(Platform(2.5, [0.0, 0.0, 0.1])) == "<Platform of 2.5 kg, centre of mass at (0, 0, 0.1) m>"
