"""Files from outside, read within bounds: bytes, text, TOML and JSON, each refused in words."""

from __future__ import annotations

import json
import re
import reprlib
import tomllib
from os import PathLike
from pathlib import Path
from typing import Any

from tensionlab.errors import DataError, InputError, TensionlabError

DATASETS_FOLDERS = tuple(parent / "datasets" for parent in Path(__file__).parents[2:4])  # installed, source tree
CHECKSUMS = "SHA256SUMS"  # marks a folder of data sets as this package's
MAX_TEXT_BYTES = 1_000_000  # a large rig has some ten thousand
MAX_NESTING = 32
MAX_INTEGER = 2**63
MAX_KEY_PARTS = 32  # the parser takes the square of their number, in time and memory
LONG_KEY = re.compile(rf"""(?:(?:"[^"\n]*"|'[^'\n]*'|[\w-]+)[ \t]*\.[ \t]*){{{MAX_KEY_PARTS}}}""")
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
    raise DataError(
        f"{DATASETS_FOLDERS[0]}: the data sets are not here; install tensionlab again, or give a folder"
    )


def brief(value: object) -> str:
    """Return the representation of a value, shortened for a message."""
    text = _short.repr(value)
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 1]}…"


def as_path(path: str | PathLike[str]) -> Path:
    """Return a path; an `InputError` for what is none."""
    try:
        return Path(path)
    except TypeError:
        raise InputError(f"{brief(path)} is no path; give one as text or as a Path") from None


def read_bytes(
    path: str | PathLike[str], what: str, error: type[TensionlabError], max_bytes: int = MAX_TEXT_BYTES
) -> bytes:
    """Return the contents of a file; what kind is wanted, such as "a rig file (*.toml)", is for messages.

    The error is raised, naming the file, if it is not there, is a folder, cannot be read, or is too large.
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
    """Return the keys and values of a TOML text, which errors call ``source``.

    It is refused if it is not valid, too large, nested too deep, or has a whole number of more than 64 bits.
    """
    if len(text) > MAX_TEXT_BYTES:
        raise error(f"{source}: has more than {MAX_TEXT_BYTES:,} characters; shorten it") from None
    if LONG_KEY.search(text):
        raise error(f"{source}: a key has more than {MAX_KEY_PARTS} parts with dots between; shorten it") from None
    try:
        document = tomllib.loads(text)
    except RecursionError:
        raise _too_deep(source, error) from None
    except tomllib.TOMLDecodeError as problem:
        raise error(f"{source}: not valid TOML: {_clipped(problem)}; correct that line") from None
    except ValueError:  # Python refuses to parse thousands of digits
        raise error(f"{source}: a whole number has thousands of digits; correct it") from None
    _require_bounded(document, source, error)
    return document


def parse_json(text: str | bytes, source: str, error: type[TensionlabError]) -> Any:
    """Return what a JSON text holds; refused as in `parse_toml`, but for the size."""
    try:
        value = json.loads(text)
    except RecursionError:
        raise _too_deep(source, error) from None
    except ValueError as problem:
        raise error(f"{source}: not valid JSON: {_clipped(problem)}; correct it") from None
    _require_bounded(value, source, error)
    return value


def _require_bounded(value: Any, source: str, error: type[TensionlabError], path: tuple[str, ...] = ()) -> None:
    """Refuse what is nested too deep to be walked by recursion, and integers that overflow a float."""
    if len(path) > MAX_NESTING:
        raise _too_deep(source, error) from None
    if type(value) is int and not -MAX_INTEGER <= value < MAX_INTEGER:
        raise error(f"{': '.join([source, *path[:1]])}: a whole number beyond 64 bits; correct it") from None
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            _require_bounded(inner, source, error, (*path, brief(key)))


def _too_deep(source: str, error: type[TensionlabError]) -> TensionlabError:
    return error(f"{source}: tables or lists are nested more than {MAX_NESTING} deep; flatten them")


def _clipped(problem: Exception) -> str:
    words = " ".join(str(problem).split())
    return words if len(words) <= 120 else f"{words[:119]}…"
