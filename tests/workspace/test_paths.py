import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tensionlab.errors import ShapeError
from tensionlab.model.kinematics import exponential
from tensionlab.workspace.paths import box, polyline, read_poses

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


def test_a_polyline_is_walked_in_even_steps():
    path = polyline([[0.0, 0.0], [3.0, 4.0], [3.0, 5.0]], step=2.5)
    np.testing.assert_allclose(path.distance, [0.0, 2.5, 5.0, 6.0])
    np.testing.assert_allclose(path.position, [[0, 0], [1.5, 2], [3, 4], [3, 5]])
    turned = polyline([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.1, rotation=np.eye(3))
    assert turned.rotation.shape == (11, 3, 3)
    assert polyline([[0.0, 0.0], [0.3, 0.0]], 0.1, rotation=0.5).rotation.tolist() == [0.5] * 4


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

    spatial = write(
        {
            "x": [1, 2],
            "y": [3.0, 4.0],
            "z": [5.0, 6.0],
            **dict(zip(("rx", "ry", "rz"), TWIST.T.tolist(), strict=True)),
        }
    )
    assert spatial.position.tolist() == [[1.0, 3.0, 5.0], [2.0, 4.0, 6.0]]
    np.testing.assert_allclose(spatial.rotation, exponential(TWIST), atol=1e-15)
    planar = write({"y": [3.0, 4.0], "x": [1.0, 2.0], "angle": [0.1, 0.2]})
    assert (planar.position.tolist(), planar.rotation.tolist()) == ([[1.0, 3.0], [2.0, 4.0]], [0.1, 0.2])
    assert write({"x": [1.0], "y": [2.0]}).rotation is None


def test_arrays_hold_positions_and_orientations(tmp_path):
    file = tmp_path / "poses.npz"
    np.savez(file, position=[[1.0, 2.0, 3.0]], rotation=[np.eye(3)])
    found = read_poses(file)
    assert found.position.tolist() == [[1.0, 2.0, 3.0]]
    assert found.rotation.shape == (1, 3, 3)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: box((1, 0), 0, step=1), "x goes from 1 to 0"),
        (lambda: box(0, (0, 1, 2), step=1), r"y has shape \(3,\)"),
        (lambda: box(0, (0, np.nan), step=1), r"y\[1\] is nan"),
        (lambda: box((0, 1), (0, 1), step=0.0), "step is 0.0"),
        (lambda: box((0, 1), (0, 1), step=[1, 1, 1]), r"step is \[1, 1, 1\]"),
        (lambda: box((0, 1), (0, 1), step=1e-9), r"1e\+09 poses along x"),
        (lambda: polyline([[0.0, 0.0]], 1.0), "no length"),
        (lambda: polyline([[0.0, 0.0], [1.0, 0.0]], -1.0), "step is -1"),
        (lambda: polyline([[0.0, 0.0], [1.0, 0.0]], 1.0, rotation=np.eye(3)), "rotation has shape"),
    ],
)
def test_odd_boxes_and_paths_are_refused(call, words):
    with pytest.raises(ShapeError, match=words):
        call()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("none.csv", None, "no such file"),
        ("poses.txt", "x,y\n1,2", "ends in .csv, .parquet, .npz"),
        ("poses.csv", "x,z\n1,2", 'column "y" is missing'),
        ("poses.csv", "x,y,z,rx\n1,2,3,4", "no column ry"),
        ("poses.csv", "x,y,Z\n1,2,3", 'what the column "Z" is'),
        ("poses.csv", "x,y\n1,a", r"line 2, column \"y\": 'a' is no finite number"),
        ("poses.csv", "x,y\n1,", r"line 2, column \"y\": '' is no finite number"),
        ("poses.csv", "", 'column "x" is missing'),
        ("poses.csv", "x,y\n", "no numbers"),
        ("poses.parquet", "x,y\n1,2", "poses.parquet"),
        ("poses.npz", "x,y\n1,2", "poses.npz"),
        ("poses.csv", "x,y,x\n1,2,3", 'column "x" is there twice'),
        ("poses.csv", "x,y\n1,2\n1,2,3", "line 3 has 3 values for 2 columns"),
        ("poses.csv", "x_mm,y_mm\n1,2", 'column "x" is missing; there must be x, y, there are x_mm, y_mm'),
        ("poses.csv", 'x,y\n1,"2', "line 2: unexpected end of data"),
        ("poses.csv", "x,y\n1,1e999", "'1e999' is no finite number"),
    ],
)
def test_odd_files_are_refused_by_name(tmp_path, name, text, words):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(ShapeError, match=words) as caught:
        read_poses(tmp_path / name)
    assert name in str(caught.value)


def test_arrays_of_other_names_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", positions=[[1.0, 2.0]])
    with pytest.raises(ShapeError, match="its arrays are positions"):
        read_poses(tmp_path / "a.npz")
