"""Encodings of documents as files, so that spoilt documents get as far as files can carry them."""

from __future__ import annotations

import io
import json
from typing import Any

from tests.stress.file_mutations import Raw


def toml(document: Any) -> bytes:
    """Write a document as TOML; what TOML does not have becomes what it can't read."""
    if not isinstance(document, dict):
        return _toml_value(document).encode("utf-8", "surrogatepass")
    lines = [f"{_toml_key(key)} = {_toml_value(value)}" for key, value in document.items()]
    return "\n".join([*lines, ""]).encode("utf-8", "surrogatepass")


def _toml_key(key: str) -> str:
    return json.dumps(key, ensure_ascii=False)


def _toml_value(value: Any) -> str:
    match value:
        case Raw():
            return value
        case str():
            return json.dumps(value, ensure_ascii=False)
        case bool():
            return "true" if value else "false"
        case dict():
            return "{" + ", ".join(f"{_toml_key(key)} = {_toml_value(each)}" for key, each in value.items()) + "}"
        case list():
            return "[" + ", ".join(map(_toml_value, value)) + "]"
        case _:
            return repr(value)


def csv(document: Any) -> bytes:
    """Write rows of cells as CSV."""
    rows = document if isinstance(document, list) else [document]
    lines = [",".join(map(str, row)) if isinstance(row, list) else str(row) for row in rows]
    return "\n".join([*lines, ""]).encode("utf-8", "surrogatepass")


def parquet(document: Any) -> bytes:
    """Write columns and their manifest as Parquet; columns of mixed values as text, all cut to one length."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = document.get("columns", {}) if isinstance(document, dict) else {}
    lists = (
        {key: value if isinstance(value, list) else [value] for key, value in dict(columns or {}).items()}
        if (isinstance(columns, dict))
        else {}
    )
    least = min(map(len, lists.values()), default=0)
    arrays = {}
    for key, values in lists.items():
        try:
            arrays[key] = pa.array(values[:least])
            pq.write_table(pa.table({"x": arrays[key]}), io.BytesIO())  # a table without fields can't be written
        except (pa.ArrowException, ValueError, TypeError, OverflowError, UnicodeError):
            arrays[key] = pa.array([ascii(each) for each in values[:least]])
    names = [key.encode("utf-8", "replace").decode() for key in arrays]
    manifest = document.get("manifest") if isinstance(document, dict) else document
    table = pa.Table.from_arrays(list(arrays.values()), names=names)
    sink = io.BytesIO()
    pq.write_table(table.replace_schema_metadata({"tensionlab": json.dumps(manifest)}), sink)
    return sink.getvalue()


def xml(document: Any) -> bytes:
    """Write an element and what is in it."""
    return ('<?xml version="1.0" encoding="utf-8"?>\n' + _element(document)).encode("utf-8", "surrogatepass")


def _element(each: Any) -> str:
    if isinstance(each, list) and len(each) == 3 and isinstance(each[1], dict):
        tag, attributes, inside = each
        words = "".join(f' {key}="{value}"' for key, value in attributes.items())
        return f"<{tag}{words}>{_element(inside)}</{tag}>"
    return "".join(map(_element, each)) if isinstance(each, list) else str(each)
