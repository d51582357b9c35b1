import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tensionlab.errors import DataError, InputError, ShapeError
from tensionlab.model.kinematics import exponential
from tensionlab.workspace.poses import Grid, PoseList, box, read_poses

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


TWIST = np.array([[0.1, -0.2, 0.3], [0.0, 0.0, 0.0]])


def test_a_box_is_filled_from_end_to_end():
    grid = box((-4, 4), (-3, 3), 2.0, step=0.1)
    assert grid.shape == (81, 61, 1)
    assert (grid.x[0], grid.x[40], grid.x[80], grid.z[0]) == (-4.0, 0.0, 4.0, 2.0)
    np.testing.assert_allclose(np.diff(grid.y), 0.1)


def test_a_step_that_does_not_divide_the_edge_stops_short():
    np.testing.assert_allclose(box((0, 1), 0, step=0.3).x, [0.0, 0.3, 0.6, 0.9])
    np.testing.assert_allclose(box((0, 1), (0, 1), (0, 1), step=[0.5, 1.0, 2.0]).x, [0.0, 0.5, 1.0])
    assert box((0, 1), (0, 1), (0, 1), step=[0.5, 1.0, 2.0]).shape == (3, 2, 1)
    assert box((2, 2), 0, step=1).x.tolist() == [2.0]


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_tables_hold_positions_and_orientations(tmp_path, suffix):
    def write(columns):
        file = tmp_path / f"poses.{suffix}"
        if suffix == "parquet":
            pq.write_table(pa.table(columns), file)
        else:
            rows = zip(*columns.values(), strict=True)
            file.write_text("\n".join([", ".join(columns), *(",".join(map(str, row)) for row in rows)]))
        return read_poses(file)

    turns = dict(zip(("rx", "ry", "rz"), TWIST.T.tolist(), strict=True))
    spatial = write({"x": [1, 2], "y": [3.0, 4.0], "z": [5.0, 6.0], **turns})
    assert spatial.position.tolist() == [[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]
    np.testing.assert_allclose(spatial.rotation, exponential(TWIST), atol=1e-15)
    planar = write({"y": [3.0, 4.0], "x": [1.0, 2.0], "angle": [0.1, 0.2]})
    assert (planar.position.tolist(), planar.rotation.tolist()) == ([[1.0, 3.0], [2.0, 4.0]], [0.1, 0.2])
    assert write({"x": [1.0], "y": [2.0]}).rotation is None
    assert write({"x": [1.0], "y": [2.0], "Fx": [3.0], "Fy": [4.0]}).wrench.tolist() == [[3.0, 4.0]]
    loaded = write({"x": [1], "y": [2], "z": [3], "Fx": [4], "Fy": [5], "Fz": [6], "My": [7]})
    assert loaded.wrench.tolist() == [[4.0, 5.0, 6.0, 0.0, 7.0, 0.0]]


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: Grid([], 0.0), ShapeError, r"x has shape \(0,\)"),
        (lambda: Grid(0.0, [[1.0]]), ShapeError, r"y has shape \(1, 1\)"),
        (lambda: Grid(0.0, 1.0, [np.nan]), ShapeError, r"z\[0\] is nan"),
        (lambda: Grid(0.0, 1.0, 2.0, np.eye(3)), ShapeError, r"rotations has shape \(3, 3\)"),
        (lambda: Grid(0.0, 1.0, 2.0, [2 * np.eye(3)]), ShapeError, r"rotations\[0\] is not a rotation"),
        (lambda: PoseList([1.0, 2.0]), ShapeError, r"position has shape \(2,\)"),
        (lambda: PoseList(np.zeros((2, 3)), [np.eye(3)]), ShapeError, r"rotation has shape \(1, 3, 3\)"),
        (lambda: box((1, 0), 0, step=1), InputError, "x goes from 1 to 0"),
        (lambda: box(0, (0, 1, 2), step=1), ShapeError, r"y has shape \(3,\)"),
        (lambda: box((0, 1), (0, 1), step=[1, 1, 1]), InputError, r"step is \[1.0, 1.0, 1.0\]"),
        (lambda: box((0, 1), (0, 1), step=1e-9), InputError, r"1e\+09 poses along x"),
    ],
)
def test_odd_poses_and_boxes_are_refused(call, error, words):
    with pytest.raises(error, match=words):
        call()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("none.csv", None, "no such file"),
        ("poses.txt", "x,y\n1,2", "ends in .csv or .parquet"),
        ("poses.csv", "x,z\n1,2", 'column "y" is missing'),
        ("poses.csv", "x,y,z,rx\n1,2,3,4", "no column ry"),
        ("poses.csv", "x,y,z,Fx\n1,2,3,4", "no column Fy"),
        ("poses.csv", "x,y,Z\n1,2,3", 'unknown column "Z"'),
        ("poses.parquet", "x,y\n1,2", "poses.parquet"),
    ],
)
def test_odd_files_are_refused_by_name(tmp_path, name, text, words):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(DataError, match=words) as caught:
        read_poses(tmp_path / name)
    assert name in str(caught.value)
