"""Tables from outside: damaged, huge, or of something else, they are refused by file, column and row."""

import io
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tensionlab.errors import ShapeError
from tensionlab.support.files import reading
from tensionlab.support.files.tables import read_npz, read_parquet, read_table


def npy(header, content=b""):
    """A file of NumPy with a header of one's own."""
    text = header.encode().ljust(118) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + content


def zipped(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)


def test_arrays_come_back(tmp_path):
    values = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.arange(4, dtype=np.int32),
        "c": np.eye(3, order="F")[:, 1:],
    }
    np.savez_compressed(tmp_path / "x.npz", **values)
    for name, array in read_npz(tmp_path / "x.npz", "arrays", ShapeError).items():
        np.testing.assert_array_equal(array, values[name])


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}"), "a damaged file"),
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -1)}", bytes(8)), "a damaged file"),
        (npy("{'descr': '|O', 'fortran_order': False, 'shape': (1,)}", b"cos\nsystem\n"), "a damaged file"),
        (npy("{'descr': '<U9', 'fortran_order': False, 'shape': (0,)}"), "an array of <U9"),
        (npy("{'descr': " + "(" * 100), "a damaged file"),
        (b"no array at all", "a damaged file"),
    ],
)
def test_an_array_that_is_none_is_refused_before_there_is_one(tmp_path, content, said):
    zipped(tmp_path / "x.npz", a=content)
    with pytest.raises(ShapeError, match=rf"x\.npz: .*{said}"):
        read_npz(tmp_path / "x.npz", "arrays (*.npz)", ShapeError)


def test_a_small_file_that_unpacks_to_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "FREE_UNPACKED_BYTES", 1_000_000)
    np.savez_compressed(tmp_path / "x.npz", **{name: np.zeros(100_000) for name in "abc"})
    with pytest.raises(ShapeError, match=r"x\.npz: [\d,]+ bytes that unpack to more than 1,[\d,]+ are not read"):
        read_npz(tmp_path / "x.npz", "arrays", ShapeError)


@pytest.mark.parametrize(
    "column",
    [
        pytest.param(lambda: pa.nulls(1_000_000, pa.float64()), id="empty rows"),
        pytest.param(lambda: pa.nulls(100_000, pa.decimal256(50)), id="wide numbers"),
        pytest.param(lambda: pa.nulls(1000, pa.binary(100_000)), id="wide bytes"),
        pytest.param(lambda: pa.nulls(1000, pa.list_(pa.float64(), 10_000)), id="lists of one length"),
        pytest.param(lambda: pa.array([np.zeros(1_000_000)], pa.list_(pa.float64())), id="a list"),
        pytest.param(lambda: pa.array(["a" * 20_000] * 1000), id="a long word"),
        pytest.param(lambda: pa.array(["ab"] * 1_000_000), id="short words"),
    ],
)
def test_a_small_table_that_unpacks_to_much_is_refused_before_it_takes_the_memory(tmp_path, monkeypatch, column):
    monkeypatch.setattr(reading, "FREE_UNPACKED_BYTES", 1_000_000)
    path = tmp_path / "x.parquet"
    pq.write_table(pa.table({"x": column()}), path, compression="zstd")
    size = path.stat().st_size
    assert size < 30_000
    before = pa.total_allocated_bytes(), pa.default_memory_pool().max_memory()
    with pytest.raises(
        ShapeError, match=rf"x\.parquet: {size:,} bytes that unpack to more than [\d,]+ are not read"
    ):
        read_parquet(path, "a table", ShapeError)
    assert pa.default_memory_pool().max_memory() <= max(before[1], before[0] + 10_000_000)


def test_a_cut_archive_is_refused_wherever_it_is_cut(tmp_path):
    sink = io.BytesIO()
    np.savez(sink, a=np.arange(50.0))
    path = tmp_path / "x.npz"
    for size in range(0, len(sink.getvalue()), 7):
        path.write_bytes(sink.getvalue()[:size])
        with pytest.raises(ShapeError, match="a damaged file"):
            read_npz(path, "arrays", ShapeError)


def parquet(path, **columns):
    pq.write_table(pa.table(columns), path)
    return path


def test_numbers_of_a_column_are_finite_or_named(tmp_path):
    path = parquet(tmp_path / "x.parquet", a=[1.0, None], b=[1.0, float("nan")], c=["x", "y"], d=[1, 2])
    table = read_parquet(path, "a table", ShapeError)
    assert table.numbers("d", ShapeError).tolist() == [1.0, 2.0]
    for name, said in {"a": "row 2: nan", "b": "row 2: nan", "c": "is of string", "e": "is missing"}.items():
        with pytest.raises(ShapeError, match=rf'x\.parquet: column "{name}".* {said}'):
            table.numbers(name, ShapeError)


def test_damaged_tables_are_refused(tmp_path):
    path = parquet(tmp_path / "x.parquet", a=list(range(2000)))
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(ShapeError, match=r"x\.parquet: a damaged file"):
        read_parquet(path, "a table", ShapeError)
    path.write_bytes(content)
    with pytest.raises(ShapeError, match="is a folder"):
        read_parquet(tmp_path, "a table", ShapeError)


def test_tables_without_rows(tmp_path):
    zipped(tmp_path / "x.npz", a=npy("{'descr': '<f8', 'fortran_order': False, 'shape': (0, 3)}"))
    assert read_npz(tmp_path / "x.npz", "arrays", ShapeError)["a"].shape == (0, 3)
    empty = pa.table({"a": pa.array([], pa.float64())})
    pq.write_table(empty, tmp_path / "x.parquet")
    assert read_parquet(tmp_path / "x.parquet", "a table", ShapeError).numbers("a", ShapeError).size == 0
    (tmp_path / "x.csv").write_text("a,b\n")
    with pytest.raises(ShapeError, match=r"x\.csv: no numbers; the first line names the columns a, b"):
        read_table(tmp_path / "x.csv", ("a", "b"), error=ShapeError)


def test_columns_of_one_name_are_refused(tmp_path):
    (tmp_path / "x.csv").write_text("a,a\n1,2\n")
    with pytest.raises(ShapeError, match='column "a" is there twice'):
        read_table(tmp_path / "x.csv", ("a",), error=ShapeError)
    path = tmp_path / "x.parquet"
    pq.write_table(pa.Table.from_arrays([pa.array([1]), pa.array([2])], names=["a", "a"]), path)
    with pytest.raises(ShapeError, match='column "a" is there twice'):
        read_parquet(path, "a table", ShapeError)


def test_lines_are_counted_as_an_editor_counts_them(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("# a table\n\nx,y\n1,2\n# a note\n3,nan\n")
    with pytest.raises(ShapeError, match=r'x\.csv: line 6, column "y": \'nan\' is no finite number'):
        read_table(path, ["x", "y"], error=ShapeError)
