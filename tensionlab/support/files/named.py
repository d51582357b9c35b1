"""Files that come with this package, by name: a word that has no separator and no suffix of its kind of file.

How a word is written makes it a name or a path, whatever lies in the current folder: ``ipanema-2`` is the rig of
this package, ``ipanema-2.toml`` and ``./ipanema-2`` are files.
"""

from __future__ import annotations

import os
import re
from os import PathLike
from pathlib import Path

from tensionlab.errors import TensionlabError
from tensionlab.support.files.reading import as_path, brief, datasets_folder
from tensionlab.support.registry import suggest

SUFFIXES = {
    "rigs": ".toml",
    "spaces": ".toml",
    "vectors": ".parquet",
    "published": ".toml",
    "recordings": ".parquet",
    "what-if": ".parquet",
    "benchmarks": ".parquet",
    "tracks": ".npz",
}  # of the files in each folder of data sets
SEPARATORS = {"/", os.sep}


def list_names(kind: str, folder: Path | None = None) -> list[str]:
    """List the names of the files of a kind, in this package's data sets or in another folder of them."""
    where = (folder or datasets_folder()) / kind
    return sorted(path.name.removesuffix(SUFFIXES[kind]) for path in where.glob(f"*{SUFFIXES[kind]}"))


def is_path(word: str | PathLike[str], suffix: str) -> bool:
    """Whether a word is the path of a file, not a name: it has a separator or the suffix, or is no text."""
    return not isinstance(word, str) or word.lower().endswith(suffix) or any(mark in word for mark in SEPARATORS)


def find(word: str | PathLike[str], kind: str, error: type[TensionlabError]) -> Path:
    """Return the path of a file of one of `SUFFIXES`, given by name or by path.

    The error is raised, saying what there is instead, for a name that is unknown, and for a path at which there is
    nothing if its last part is a name.
    """
    suffix, what = SUFFIXES[kind], kind.removesuffix("s")
    if not is_path(word, suffix):
        if word not in (known := list_names(kind)):
            if os.path.exists(f"{word}{suffix}"):  # noqa: PTH110 - takes what no system does
                raise error(f"no {what} of tensionlab is called {word!r}; for the file give {word}{suffix}")
            advice = suggest(str(word), known, f"`tensionlab datasets {kind}` lists them.")
            raise error(f"no {what} is called {brief(word)}; {advice} A path ends in {suffix} or has a '/'")
        return datasets_folder() / kind / f"{word}{suffix}"
    path = as_path(word)
    name = re.split(r"[/\\]", str(word))[-1].removesuffix(suffix)
    if not os.path.exists(path) and name in list_names(kind):  # noqa: PTH110 - takes what no system does
        raise error(f"{path}: no such file; the {what} that comes with tensionlab is called {name!r}")
    return path
