"""Where a result came from: the manifest that every written result carries, and tables in Parquet."""

from __future__ import annotations

import json
import platform
import shlex
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tensionlab.errors import optional_import
from tensionlab.support.files import writing
from tensionlab.support.files.reading import as_path
from tensionlab.support.operating_system import processor_name

if TYPE_CHECKING:
    import pandas

LIBRARIES = [
    "numpy", "scipy", "qpsolvers", "clarabel", "osqp", "daqp", "quadprog", "piqp", "proxsuite", "highspy", "cvxpy",
    "cvxpy-base", "matplotlib", "xarray", "zarr", "distributed", "mcap",
]  # fmt: skip  # other distributions whose version may change a result
TABLE_SUFFIXES = (".parquet", ".csv")


def manifest(call: Sequence[str], seed: int | None = None) -> dict[str, Any]:
    """Return which call, versions and machine a result came from.

    ``call``, program and arguments, one word each; ``date`` (UTC); ``seed`` of the random numbers, None where
    nothing was random; ``git_commit`` of the working directory (ends in ``-dirty`` where files differ from it;
    None outside a repository); ``processor``, ``platform``, ``python`` and ``versions`` (by distribution; only
    those installed).
    """
    import importlib.metadata

    from tensionlab import __version__

    versions = {"tensionlab": __version__}
    for name in LIBRARIES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {
        "call": shlex.join(call),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seed": seed,
        "git_commit": _git_commit(),
        "processor": processor_name(),
        "platform": platform.platform(),
        "python": platform.python_version(),
        "versions": versions,
    }


def write_parquet(
    path: str | Path, table: Sequence[Mapping[str, Any]] | Mapping[str, Any], manifest: Mapping[str, Any]
) -> None:
    """Write a table, given as rows or as columns, with its manifest as JSON in the schema's metadata.

    ``json.loads(pyarrow.parquet.read_schema(path).metadata[b"tensionlab"])`` reads the manifest. `WriteError` if
    the file cannot be written; an earlier file stays.
    """
    with optional_import("data", "writing Parquet"):
        import pyarrow as pa
        import pyarrow.parquet as pq
    if isinstance(table, Mapping):
        written = pa.table(dict(table))
    else:
        written = pa.Table.from_pylist([dict(row) for row in table])
    with writing.replacing(path) as file:
        pq.write_table(written.replace_schema_metadata({"tensionlab": json.dumps(dict(manifest))}), file)


def write_table(
    path: str | Path, table: Sequence[Mapping[str, Any]] | Mapping[str, Any], manifest: Mapping[str, Any]
) -> None:
    """Write a table, as `write_parquet`, in the format of the suffix: Parquet, or CSV without the manifest."""
    if as_path(path).suffix.lower() == ".csv":
        text = data_frame(table).to_csv(index=False, lineterminator="\n")
        writing.write_text(path, text)
    else:
        write_parquet(path, table, manifest)


def data_frame(table: Sequence[Mapping[str, Any]] | Mapping[str, Any], index: Any = None) -> pandas.DataFrame:
    """Return a table, as in `write_parquet`, with pandas; MissingDependency if that is not installed."""
    with optional_import("data", "a data frame"):
        import pandas
    return pandas.DataFrame(table, index)


def import_xarray() -> Any:
    """Return the module xarray; MissingDependency if it is not installed."""
    with optional_import("workspace", "a dataset"):
        import xarray
    return xarray


def _git_commit() -> str | None:
    """Commit of the working directory; None outside a repository or without git."""
    # A repository's own settings may name a program for git to run (fsmonitor); it must not run here.
    describe = ["describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    command = ["git", "-c", "core.fsmonitor=false", *describe]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
