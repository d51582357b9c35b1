"""Stamps of pictures: what they were drawn from and by, so that a test says which ones are stale.

A stamp is a hash of the picture, of its data, and of the code that draws it, without comments and docstrings.
The scripts that draw write the stamps of what they drew to ``stamps.json``.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
STAMPS = Path(__file__).with_name("stamps.json")
COMMON = ("tensionlab/plots/style.py", "tensionlab/support/colours.py", "tensionlab/tensionlab.mplstyle")
# Docstrings, comments on lines of their own, and empty lines.
WORDS = re.compile(rb'^[ \t]*(?:"""(?:.|\n)*?"""|#.*)?[ \t]*\n', re.MULTILINE)


def stamp(picture: Path, sources: Sequence[str], text: str = "", root: Path = ROOT) -> str:
    """Return the hash of a picture with what it was made of.

    Parameters
    ----------
    picture : Path
        File that was drawn.
    sources : sequence of str
        Patterns of the files with its data and its code, relative to the root.
    text : str, optional
        Commands that draw it.
    root : Path, optional
        Root of the repository.

    Raises
    ------
    FileNotFoundError
        If a pattern has no file.
    """
    found = hashlib.sha256(text.encode() + picture.read_bytes())
    for pattern in sources:
        files = sorted(path for path in root.glob(pattern) if path.is_file())
        if not files:
            raise FileNotFoundError(f"no file is called {pattern}, which {picture.name} is drawn from")
        for path in files:
            content = path.read_bytes().replace(b"\r\n", b"\n")
            found.update(WORDS.sub(b"", content) if path.suffix == ".py" else content)
    return found.hexdigest()[:16]


def read() -> dict[str, str]:
    """Return the stamp of each picture, by its path in docs."""
    return dict(json.loads(STAMPS.read_text(encoding="utf-8"))) if STAMPS.exists() else {}


def update(stamps: dict[str, str]) -> None:
    """Write the stamps of pictures that were drawn; those of files that are gone are left out."""
    known = {name: value for name, value in (read() | stamps).items() if (ROOT / "docs" / name).exists()}
    STAMPS.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")
