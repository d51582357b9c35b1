"""Write the checksums of all data sets, in the format of `sha256sum`: ``python -m tools.checksums``."""

from __future__ import annotations

import hashlib
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "datasets"
FILE = FOLDER / "SHA256SUMS"
SUFFIXES = (".csv", ".json", ".npz", ".parquet", ".toml")


def checksums() -> str:
    """Which checksum does each data file have? A line each, in order of their names."""
    files = sorted(path.relative_to(FOLDER).as_posix() for path in FOLDER.rglob("*") if path.suffix in SUFFIXES)
    return "".join(f"{hashlib.sha256((FOLDER / name).read_bytes()).hexdigest()}  {name}\n" for name in files)


if __name__ == "__main__":
    FILE.write_text(checksums(), encoding="utf-8", newline="\n")
    print(f"checksums: {FILE}")
