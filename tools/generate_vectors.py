"""Write the 182 directions of the technical validation: ``python -m tools.generate_vectors [FILE]``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from tensionlab.model.directions import grid18
from tensionlab.support import provenance

FILE = Path("datasets") / "vectors" / "grid18.parquet"


def main() -> None:
    """Write unit vectors, with their angles from Y and about it, in degrees."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    vectors = grid18()
    polar = np.degrees(np.arctan2(np.hypot(vectors[:, 0], vectors[:, 2]), vectors[:, 1]))
    azimuth = np.degrees(np.arctan2(vectors[:, 2], vectors[:, 0]))
    columns = {
        "vector": np.arange(len(vectors)),
        **dict(zip("xyz", vectors.T, strict=True)),
        "polar": polar.round(9),
        "azimuth": np.mod(azimuth.round(9), 360.0),
    }
    words = ["python", "-m", "tools.generate_vectors", *sys.argv[1:]]
    provenance.write_parquet(path, columns, provenance.manifest(words))
    print(f"vectors: {path}")


if __name__ == "__main__":
    main()
