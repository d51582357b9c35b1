"""What was measured, kept line by line, so that an interrupted validation goes on where it was."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tensionlab.errors import LogError, WriteError
from tensionlab.files import writing
from tensionlab.files.reading import brief, parse_json, read_text
from tensionlab.files.tables import MAX_FILE_BYTES, from_mappings
from tensionlab.validation.protocol import Measurement

FORMAT = "tensionlab validation 1"


class Journal:
    """A file of JSON lines: the setup, and then a line for each measurement.

    Parameters
    ----------
    path : path
        Made if it is not there. What an interrupted validation left is taken over.
    setup : mapping
        What must not differ between the sittings of one validation: numbers, words and lists.

    Attributes
    ----------
    measurements : list of Measurement
        In the order of their numbers, without a gap.

    Raises
    ------
    LogError
        Naming the file: it is of another validation, is damaged, or can't be read or written.
    """

    def __init__(self, path: Path, setup: Mapping[str, Any]) -> None:
        self.path = path
        self.measurements: list[Measurement] = []
        head = {"format": FORMAT, **setup}
        try:
            text = (
                read_text(path, "the journal of a validation", LogError, MAX_FILE_BYTES) if path.exists() else ""
            )
            whole = text[: text.rfind("\n") + 1]  # a process that was killed may have left half a line
            if whole:
                found, self.measurements = _parsed(path, whole)
                _require_same(path, found, head)
            else:
                whole = json.dumps(head) + "\n"
            if whole != text:
                writing.write_text(path, whole)
        except WriteError as error:
            raise LogError(str(error)) from None
        except OSError as error:
            raise LogError(f"{path}: cannot be used ({error}); name another folder") from None

    def add(self, measurement: Measurement) -> None:
        """Keep a measurement for good. One that is there already is not kept again."""
        if measurement.number < len(self.measurements):
            return
        assert measurement.number == len(self.measurements)
        self.measurements.append(measurement)
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(measurement)) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise LogError(f"{self.path}: cannot be written ({error.strerror}); free the disk and go on") from None


def _parsed(path: Path, text: str) -> tuple[dict[str, Any], list[Measurement]]:
    measurements: list[Measurement] = []
    head: dict[str, Any] = {}
    for number, line in enumerate(text.splitlines()):
        here = f"{path}, line {number + 1}"
        content = parse_json(line, here, LogError)
        if not isinstance(content, dict):
            raise LogError(f"{here}: is {brief(content)}; it is damaged, name another folder")
        if number == 0:
            head = content
            continue
        values = {key: tuple(value) if isinstance(value, list) else value for key, value in content.items()}
        measurements += from_mappings([values], Measurement, here, LogError)
        if measurements[-1].number != number - 1:
            due = f"force {measurements[-1].number} where {number - 1} is due"
            raise LogError(f"{here}: damaged ({due}); name another folder")
    return head, measurements


def _require_same(path: Path, found: Mapping[str, Any], head: Mapping[str, Any]) -> None:
    other = [key for key in {**head, **found} if found.get(key) != head.get(key)]
    if other:
        raise LogError(
            f"{path} is of a validation with other {', '.join(other):.100}; go on with the same, "
            "or name another folder"
        )
