"""The directions of the technical validation as a file: ``python -m tensionlab.validation.vectors [FILE]``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from tensionlab import records
from tensionlab.arrays import Floats
from tensionlab.errors import ShapeError
from tensionlab.files.tables import read_parquet
from tensionlab.model.directions import grid18

FILE = Path("datasets") / "vectors" / "grid18.parquet"


def write(path: str | Path, vectors: Floats, manifest: dict[str, object]) -> None:
    """Write unit vectors, (K, 3), with their angles from Y and about it."""
    polar = np.degrees(np.arctan2(np.hypot(vectors[:, 0], vectors[:, 2]), vectors[:, 1]))
    azimuth = np.degrees(np.arctan2(vectors[:, 2], vectors[:, 0]))
    columns = {
        "vector": np.arange(len(vectors)),
        **dict(zip("xyz", vectors.T, strict=True)),
        "polar": polar.round(9),
        "azimuth": np.mod(azimuth.round(9), 360.0),
    }
    records.write_parquet(path, columns, manifest)


def read(path: str | Path) -> Floats:
    """Which unit vectors, (K, 3), are in a file?

    Raises
    ------
    ShapeError
        If there are none.
    """
    table = read_parquet(path, "a table of vectors (*.parquet)", ShapeError)
    return np.column_stack([table.numbers(axis, ShapeError) for axis in "xyz"])


def main() -> None:
    """Write the 182 vectors."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    write(path, grid18(), records.manifest(["python", "-m", "tensionlab.validation.vectors", *sys.argv[1:]]))
    print(f"vectors: {path}")


if __name__ == "__main__":
    main()
