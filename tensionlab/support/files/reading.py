"""Files from outside, read within bounds: bytes, text, TOML and JSON, each refused in words."""

from __future__ import annotations

import json
import reprlib
import tomllib
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

from tensionlab.errors import DataError, InputError, TensionlabError

ROOTS = tuple(Path(__file__).parents[2:4])  # installed, source tree
DATASETS_FOLDERS = tuple(parent / "datasets" for parent in ROOTS)
CHECKSUMS = "SHA256SUMS"  # marks a folder of data sets as this package's
MAX_TEXT_BYTES = 1_000_000  # a large rig has some ten thousand
# Unpacked, a file has at most the first; a small one at most the second plus the third for each of its own bytes
# (tables and logs of runs unpack to some five).
MAX_UNPACKED_BYTES, FREE_UNPACKED_BYTES, MAX_UNPACKED_RATIO = 1_600_000_000, 64_000_000, 64
MAX_NAME = 100  # characters of the name of a part of a rig, or of a module
MAX_SHOWN = 80  # characters of a value in a message

_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = 60
_short.maxlevel = 3


def require_unpackable(unpacked: int, size: int, source: str, error: type[TensionlabError]) -> None:
    """Refuse a file of a size in bytes that unpacks to more than its limit, in all."""
    limit = min(MAX_UNPACKED_BYTES, FREE_UNPACKED_BYTES + MAX_UNPACKED_RATIO * size)
    if not 0 <= unpacked <= limit:
        raise error(f"{source}: {size:,} bytes that unpack to more than {limit:,} are not read; split the file")


def datasets_folder() -> Path:
    """Return the folder of the data sets that come with this package; `DataError` if it is missing.

    Examples
    --------
    >>> import tensionlab as tl
    >>> (tl.datasets.folder() / "README.md").is_file()
    True
    """
    for folder in DATASETS_FOLDERS:
        if (folder / CHECKSUMS).is_file():
            return folder
    raise DataError(f"{DATASETS_FOLDERS[0]}: the data sets are not here; install tensionlab again")


def get_include() -> str:
    """Return the folder of the C and C++ headers, for the include path of a compiler.

    Examples
    --------
    >>> import tensionlab as tl
    >>> command = ["c++", "-std=c++17", f"-I{tl.get_include()}", "program.cpp"]
    """
    folders = [parent / "include" for parent in ROOTS]
    return str(next((folder for folder in folders if (folder / "tensionlab").is_dir()), folders[0]))


def brief(value: object) -> str:
    """Return the representation of a value, shortened for a message."""
    text = _short.repr(value)
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 1]}…"


def as_path(path: str | PathLike[str]) -> Path:
    """Return a path; an `InputError` refuses anything else."""
    try:
        return Path(path)
    except TypeError:
        raise InputError(f"{brief(path)} is no path; give one as text or as a Path") from None


def read_bytes(
    path: str | PathLike[str], what: str, error: type[TensionlabError], max_bytes: int = MAX_TEXT_BYTES
) -> bytes:
    """Return the contents of a file; ``what`` says in messages what to give, such as "a rig file (*.toml)".

    The error names the file if it does not exist, is a folder, cannot be read, or is too large.
    """
    place = as_path(path)
    try:
        with place.open("rb") as file:
            content = file.read(max_bytes + 1)
    except FileNotFoundError:
        raise error(f"{path}: no such file; give the path of {what}") from None
    except IsADirectoryError:
        raise error(f"{path}: is a folder; give {what}") from None
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror}); give {what}") from None
    except ValueError as problem:  # a path that no system takes
        raise error(f"{brief(str(path))}: cannot be read ({problem}); give {what}") from None
    if len(content) > max_bytes:
        raise error(f"{path}: has more than {max_bytes:,} bytes; give {what}")
    return content


def read_text(
    path: str | PathLike[str], what: str, error: type[TensionlabError], max_bytes: int = MAX_TEXT_BYTES
) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark; else as `read_bytes`."""
    try:
        return read_bytes(path, what, error, max_bytes).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"{path}: not UTF-8 text; save it as UTF-8, or give {what}") from None


def read_toml(path: str | PathLike[str], what: str, error: type[TensionlabError]) -> dict[str, Any]:
    """Return the tables of a TOML file, as `read_bytes` and `parse_toml` do."""
    return parse_toml(read_text(path, what, error), str(path), error)


def parse_toml(text: str, source: str, error: type[TensionlabError]) -> dict[str, Any]:
    """Return the keys and values of a TOML text, which errors call ``source``."""
    document: dict[str, Any] = _parse(tomllib.loads, text, "TOML", source, error)
    return document


def parse_json(text: str | bytes, source: str, error: type[TensionlabError]) -> Any:
    """Return what a JSON text holds; errors call it ``source``."""
    return _parse(json.loads, text, "JSON", source, error)


def _parse(
    parse: Callable[[Any], Any], text: str | bytes, kind: str, source: str, error: type[TensionlabError]
) -> Any:
    try:
        return parse(text)
    except RecursionError:
        raise error(f"{source}: tables or lists are nested too deep; flatten them") from None
    except ValueError as problem:
        words = " ".join(str(problem).split())
        clipped = words if len(words) <= 120 else f"{words[:119]}…"
        raise error(f"{source}: not valid {kind}: {clipped}; correct it") from None
