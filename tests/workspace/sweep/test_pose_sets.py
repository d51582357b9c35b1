import numpy as np
import pytest

from tensionlab.errors import ShapeError
from tensionlab.model.kinematics import exponential
from tensionlab.workspace.sweep.pose_sets import Grid, PoseList

TURNS = exponential(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.3]]))


def test_a_grid_is_every_combination_and_the_last_axis_runs_fastest():
    grid = Grid([0.0, 1.0], [5.0], [-1.0, -2.0, -3.0])
    position, rotation = grid.arrays()
    assert grid.dims == ("x", "y", "z")
    assert grid.shape == (2, 1, 3)
    assert rotation is None
    assert position.tolist() == [[x, 5.0, z] for x in (0.0, 1.0) for z in (-1.0, -2.0, -3.0)]


def test_orientations_are_one_more_axis():
    spatial = Grid([0.0, 1.0], 5.0, 2.0, TURNS)
    assert spatial.dims == ("x", "y", "z", "orientation")
    assert spatial.shape == (2, 1, 1, 2)
    position, rotation = spatial.arrays()
    assert position[:, 0].tolist() == [0.0, 0.0, 1.0, 1.0]
    np.testing.assert_array_equal(rotation, np.concatenate([TURNS, TURNS]))
    planar = Grid([0.0, 1.0], 5.0, rotations=[0.1, 0.2, 0.3])
    assert planar.dims == ("x", "y", "angle")
    assert planar.arrays()[1].tolist() == [0.1, 0.2, 0.3] * 2


@pytest.mark.parametrize(
    "grid",
    [
        Grid(np.arange(4.0), np.arange(3.0), np.arange(5.0), TURNS),
        Grid(np.arange(4.0), np.arange(3.0), rotations=[0.1, 0.2, 0.3]),
    ],
)
def test_blocks_of_a_grid_are_parts_of_it(grid):
    block = (slice(1, 3), slice(0, 2), slice(2, 5), slice(1, 2))[: len(grid.shape)]
    for whole, part in zip(grid.arrays(), grid.block(block).arrays(), strict=True):
        inside = whole.reshape(*grid.shape, *whole.shape[1:])[block]
        np.testing.assert_array_equal(part, inside.reshape(-1, *whole.shape[1:]))


def test_a_grid_of_a_million_million_poses_takes_no_memory():
    axis = np.linspace(0.0, 1.0, 10_000)
    assert Grid(axis, axis, axis).block([slice(9_999, 10_000)] * 3).arrays()[0].tolist() == [[1.0, 1.0, 1.0]]


def test_blocks_of_a_list_are_parts_of_it():
    poses = PoseList(np.arange(12.0).reshape(4, 3), np.repeat(TURNS, 2, axis=0), np.arange(4.0))
    part = poses.block([slice(1, 3)])
    assert (poses.dims, poses.shape, part.shape) == (("pose",), (4,), (2,))
    assert part.position.tolist() == [[3.0, 4.0, 5.0], [6.0, 7.0, 8.0]]
    assert part.distance.tolist() == [1.0, 2.0]
    np.testing.assert_array_equal(part.rotation, TURNS)


@pytest.mark.parametrize(
    "poses",
    [
        Grid([0.0, 1.0], 5.0, 2.0, TURNS),
        Grid([0.0, 1.0], 5.0, rotations=[0.1]),
        PoseList([[1.0, 2.0, 3.0]], TURNS[:1], [0.0]),
        PoseList([[1.0, 2.0]], [0.5]),
    ],
)
def test_coordinates_have_units_and_fit_the_axes(poses):
    sizes = dict(zip(poses.dims, poses.shape, strict=True)) | {"row": 3, "column": 3}
    units = {"x": "m", "y": "m", "z": "m", "distance": "m", "angle": "rad"}
    for each in poses.coordinates():
        assert each.values.shape == tuple(sizes[dim] for dim in each.dims)
        assert each.units == units.get(each.name, "1")
        assert each.long_name
    assert {dim for each in poses.coordinates() for dim in each.dims} >= set(poses.dims)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Grid([], 0.0), r"x has shape \(0,\)"),
        (lambda: Grid(0.0, [[1.0]]), r"y has shape \(1, 1\)"),
        (lambda: Grid(0.0, 1.0, [np.nan]), r"z\[0\] is nan"),
        (lambda: Grid(0.0, "a"), "y is not an array of numbers"),
        (lambda: Grid(0.0, 1.0, 2.0, np.eye(3)), r"rotations has shape \(3, 3\)"),
        (lambda: Grid(0.0, 1.0, 2.0, [2 * np.eye(3)]), r"rotations\[0\] is not a rotation"),
        (lambda: Grid(0.0, 1.0, rotations=[]), r"rotations has shape \(0,\)"),
        (lambda: PoseList([1.0, 2.0]), r"position has shape \(2,\)"),
        (lambda: PoseList(np.zeros((0, 3))), r"position has shape \(0, 3\)"),
        (lambda: PoseList([[0.0, 1.0, np.inf]]), r"position\[0, 2\] is inf"),
        (lambda: PoseList(np.zeros((2, 3)), [np.eye(3)]), r"rotation has shape \(1, 3, 3\)"),
        (lambda: PoseList(np.zeros((2, 2)), [0.0]), r"rotation has shape \(1,\)"),
        (lambda: PoseList(np.zeros((2, 2)), None, [0.0]), r"distance has shape \(1,\)"),
    ],
)
def test_odd_poses_are_refused(make, words):
    with pytest.raises(ShapeError, match=words):
        make()
