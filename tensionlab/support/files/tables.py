"""Tables of numbers from outside: CSV, Parquet and NPZ files, read within bounds and refused in words."""

from __future__ import annotations

import csv
import io
import math
import zipfile
from array import array
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from tensionlab.errors import TensionlabError, optional_import
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import as_path, brief, parse_json, read_bytes, read_text, require_unpackable

MAX_FILE_BYTES = 500_000_000


def csv_rows(text: str, source: str, error: type[TensionlabError]) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of each line, with its number from 1; skip empty lines and those that begin with #.

    A line that is not CSV is refused, such as one with an open quotation mark.
    """
    for number, line in enumerate(io.StringIO(text), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            cells = next(csv.reader([line.rstrip("\r\n")], strict=True))
        except (csv.Error, StopIteration) as problem:
            raise error(f"{source}: line {number}: {problem}; correct that line") from None
        yield number, [cell.strip() for cell in cells]


def read_table(
    path: str | PathLike[str],
    needed: Sequence[str],
    optional: Collection[str] = (),
    *,
    error: type[TensionlabError],
    what: str = "a table of numbers (*.csv)",
) -> dict[str, Floats]:
    """Return the numbers of each column of a CSV file whose first line names the columns.

    A file is refused without the columns that are needed, and with others than those and the optional ones.
    """
    rows = csv_rows(read_text(path, what, error, MAX_FILE_BYTES), str(path), error)
    _, heading = next(rows, (0, []))
    check_columns(heading, needed, optional, str(path), error)
    values = array("d")
    for number, cells in rows:
        if len(cells) != len(heading):
            raise error(f"{path}: line {number} has {len(cells)} values for {len(heading)} columns")
        for column, word in zip(heading, cells, strict=True):
            with suppress(ValueError):
                if math.isfinite(value := float(word)):
                    values.append(value)
                    continue
            raise error(f'{path}: line {number}, column "{column}": {brief(word)} is no finite number')
    if not values:
        raise error(f"{path}: no numbers; the first line names the columns {', '.join(needed)}")
    table = np.array(values).reshape(-1, len(heading))
    return {name: table[:, column] for column, name in enumerate(heading)}


def read_columns(
    path: str | PathLike[str],
    needed: Sequence[str],
    optional: Collection[str],
    error: type[TensionlabError],
    what: str,
) -> dict[str, Floats]:
    """Return the numbers of each column of a file that ends in .csv or .parquet; see `read_table`."""
    suffix = as_path(path).suffix.lower()
    if suffix == ".csv":
        return read_table(path, needed, optional, error=error, what=f"{what} (*.csv)")
    if suffix != ".parquet":
        raise error(f"{path}: not {what}; give one that ends in .csv or .parquet")
    table = read_parquet(path, f"{what} (*.parquet)", error)
    names = table.columns.column_names
    check_columns(names, needed, optional, str(path), error)
    return {name: table.numbers(name, error) for name in names}


def table_text(columns: Mapping[str, Floats | Sequence[float]]) -> str:
    """Return columns of numbers as CSV, with ten digits."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([f"{value:.10g}" for value in row] for row in zip(*columns.values(), strict=True))
    return text.getvalue()


def check_columns(
    names: Sequence[str],
    needed: Sequence[str],
    optional: Collection[str],
    source: str,
    error: type[TensionlabError],
) -> None:
    """Refuse columns that are missing, are there twice, or are not known."""
    for name in (*needed, *optional):
        if names.count(name) > 1:
            raise error(f'{source}: column "{name}" is there twice; there must be {", ".join(needed)}')
        if name in needed and name not in names:
            raise error(f"{missing_column(name, names, source)}; there must be {', '.join(needed)}")
    known = [*needed, *optional]
    for name in names:
        if name not in known:
            raise error(f'{source}: unknown column "{name:.40}"; there may be {", ".join(known)}')


def missing_column(name: str, names: Sequence[str], source: str) -> str:
    """Return that a column is missing, and which there are."""
    return f'{source}: column "{name:.40}" is missing; there are {", ".join(names[:20]) or "none":.100}'


class ParquetTable(NamedTuple):
    """Parquet file: its columns, and the manifest in its metadata."""

    source: str
    columns: Any
    """The table, as pyarrow has it."""
    manifest: dict[str, Any]
    """Empty if there is none."""

    def numbers(self, name: str, error: type[TensionlabError]) -> Floats:
        """Return a column of finite numbers, (K,)."""
        import pyarrow as pa

        if name not in self.columns.column_names:
            raise self._missing(name, error)
        column = self.columns[name]
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
            raise error(f'{self.source}: column "{name}" is of {column.type}; it must be of numbers')
        values: Floats = np.asarray(column.to_numpy(), dtype=np.float64)  # missing ones become NaN
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise error(f'{self.source}: column "{name}", row {row + 1}: {values[row]} is no finite number')
        return values

    def values(self, name: str, kind: type, error: type[TensionlabError]) -> list[Any]:
        """Return a column whose values are all of a type, such as str."""
        if name not in self.columns.column_names:
            raise self._missing(name, error)
        values: list[Any] = self.columns[name].to_pylist()
        for number, value in enumerate(values, start=1):
            if not isinstance(value, kind):
                wrong = f"row {number}: {brief(value)} is no {kind.__name__}"
                raise error(f'{self.source}: column "{name:.40}", {wrong}')
        return values

    def _missing(self, name: str, error: type[TensionlabError]) -> TensionlabError:
        return error(missing_column(name, self.columns.column_names, self.source))


def read_parquet(path: str | PathLike[str], what: str, error: type[TensionlabError]) -> ParquetTable:
    """Return the table of a Parquet file, with its manifest."""
    with optional_import("data", "reading Parquet"):
        import pyarrow as pa
        import pyarrow.compute as pc
        import pyarrow.parquet as pq

    data = read_bytes(path, what, error, MAX_FILE_BYTES)
    try:
        schema = pq.read_schema(pa.BufferReader(data))
        text = [field.name for field in schema if pa.types.is_string(field.type)]
        file = pq.ParquetFile(pa.BufferReader(data), read_dictionary=text)  # each word once
        require_unpackable(_unpacked_bytes(file), len(data), str(path), error)
        table = file.read()
        table.validate(full=True)
        words = [chunk for name in text for chunk in table[name].chunks]
        lengths = (pc.sum(pc.take(pc.binary_length(chunk.dictionary), chunk.indices)).as_py() for chunk in words)
        require_unpackable(table.nbytes + sum(length or 0 for length in lengths), len(data), str(path), error)
        table = table.cast(schema)
    except TensionlabError:
        raise
    except Exception as problem:  # whatever a decoder raises over damaged bytes
        raise error(f"{path}: a damaged file ({type(problem).__name__}); give {what}") from None
    names = table.column_names
    for name in names:
        if names.count(name) > 1:
            raise error(f'{path}: column "{name}" is there twice; give each its own name')
    kept = (table.schema.metadata or {}).get(b"tensionlab", b"{}")
    manifest = parse_json(kept, f"{path}: its manifest", error)
    if not isinstance(manifest, dict):
        raise error(f"{path}: its manifest is {brief(manifest)}; give {what}")
    return ParquetTable(str(path), table, manifest)


def _unpacked_bytes(file: Any) -> int:
    """Return the bytes that a Parquet file says it unpacks to: pages, values of lists, and empty rows too."""
    about = file.metadata
    groups = [about.row_group(number) for number in range(about.num_row_groups)]
    values = [group.column(column).num_values for group in groups for column in range(about.num_columns)]
    sizes = [group.total_byte_size for group in groups]
    if min([about.num_rows, *values, *sizes]) < 0:
        return -1
    total: int = sum(sizes) + 8 * sum(values) + about.num_rows * sum(map(_width, file.schema_arrow.types))
    return total


def _width(kind: Any) -> int:
    """Return the bytes that a row of an Arrow type takes, apart from what is in lists and text."""
    import pyarrow as pa

    if pa.types.is_fixed_size_list(kind):
        return int(kind.list_size) * _width(kind.value_type)
    if pa.types.is_nested(kind):
        return 8 + sum(_width(kind.field(number).type) for number in range(kind.num_fields))
    try:
        return max(8, int(kind.bit_width) // 8)
    except ValueError:  # of text
        return 8


def read_npz(
    path: str | PathLike[str], what: str, error: type[TensionlabError], absent: Collection[str] = ()
) -> dict[str, Floats]:
    """Return the arrays of numbers in an NPZ file; without those that may be ``absent``, and are None.

    The file is unpacked up to a bound: a small one may unpack to more than the memory.
    """
    data = read_bytes(path, what, error, MAX_FILE_BYTES)
    arrays: dict[str, Floats] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()  # nothing is unpacked beyond the size that is given there
            require_unpackable(sum(entry.file_size for entry in members), len(data), str(path), error)
            for entry in members:
                name, content = entry.filename.removesuffix(".npy"), archive.read(entry)
                if name in absent and b"'descr': '|O'" in content[:128] and b"'shape': ()" in content[:128]:
                    continue  # a single Python object, as NumPy writes None
                array = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
                if array.dtype.kind not in "fiu":
                    raise error(f"{path}: {entry.filename:.40}: an array of {array.dtype}; give one of numbers")
                arrays[name] = np.asarray(array, np.float64)
    except TensionlabError:
        raise
    except Exception as problem:  # whatever a decoder raises over damaged bytes
        raise error(f"{path}: a damaged file ({type(problem).__name__}); give {what}") from None
    return arrays
