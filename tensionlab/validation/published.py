"""What a publication found, as numbers with their source."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tensionlab.errors import ShapeError
from tensionlab.files.reading import read_toml


@dataclass(frozen=True)
class Value:
    """A published number.

    Attributes
    ----------
    value : float
    unit : str
        Empty for a count.
    meaning : str
        In a few words.
    reading : str
        How we read it where the publication leaves room; empty where it does not.
    """

    value: float
    unit: str
    meaning: str
    reading: str = ""


@dataclass(frozen=True)
class Published:
    """What was done, and what was found: values by name, and the source of them all."""

    source: str
    protocol: dict[str, Value]
    results: dict[str, Value]


def read(path: str | Path) -> Published:
    """Which published values are in a file?

    Raises
    ------
    ShapeError
        If there are none; says what is missing or unknown.
    """
    tables = read_toml(path, "published values (*.toml)", ShapeError)
    try:
        parts = {
            part: {name: Value(**entry) for name, entry in tables[part].items()}
            for part in ("protocol", "results")
        }
        return Published(source=tables["source"], **parts)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ShapeError(f"{path}: no published values ({type(error).__name__}: {error})") from None
