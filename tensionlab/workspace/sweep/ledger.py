"""What is in the store of a sweep, and complete: a file of lines in the store, with a checksum of every file.

The first line names the sweep and has the checksums of what is there before the first value: metadata, coordinates
and manifest. Then comes a line for each finished chunk, written once its data are on disk, and at last one that
says that the sweep is complete. Every line begins with a checksum of its own, so that a line that was cut short
or damaged does not count: its chunk is evaluated again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Set
from pathlib import Path
from typing import Any

from tensionlab.errors import SweepError

LEDGER = ".ledger"
LOCK = ".lock"
"""Held by the process that writes to the store."""
FORMAT = "tensionlab sweep 1"

Checksums = Mapping[str, str | None]
"""By path in the store; None for a chunk without a file, which Zarr leaves out where all values are NaN."""


class Ledger:
    """What a store holds, as its ledger tells.

    Parameters
    ----------
    store : path
        Of a folder.

    Attributes
    ----------
    sweep : mapping or None
        What makes the sweep this one and no other; None if there is no ledger that can be read.
    complete : bool
        Whether the sweep was finished.
    """

    def __init__(self, store: Path) -> None:
        self._store = store
        self.sweep: Mapping[str, Any] | None = None
        self.complete = False
        self._base: Checksums = {}
        self._chunks: dict[int, Checksums] = {}
        try:
            lines = (store / LEDGER).read_bytes().split(b"\n")[:-1]  # a last one without an end was cut short
        except OSError:
            return
        for content in filter(None, map(_content, lines)):
            self.complete = content.get("complete") == len(self._chunks)
            if content.get("format") == FORMAT:
                self.sweep, self._base = content["sweep"], content["files"]
            elif "chunk" in content:
                self._chunks[content["chunk"]] = content["files"]

    def begin(self, sweep: Mapping[str, Any]) -> None:
        """Write the first line: what the store holds so far belongs to this sweep."""
        inside = (path for path in self._store.rglob("*") if path.is_file() and path.name not in (LEDGER, LOCK))
        self.sweep, self._base = (
            sweep,
            {path.relative_to(self._store).as_posix(): checksum(path) for path in inside},
        )
        self.rewrite()

    def add(self, number: int, files: Checksums) -> None:
        """Add the line of a finished chunk, whose files must be on disk."""
        self._chunks[number] = files
        with (self._store / LEDGER).open("ab") as ledger:
            ledger.write(_line({"chunk": number, "files": files}))
            ledger.flush()
            os.fsync(ledger.fileno())

    def finish(self) -> None:
        """Say that the sweep is complete."""
        self.complete = True
        self.rewrite()

    def rewrite(self) -> None:
        """Write the whole anew, at once or not at all."""
        new = self._store / f"{LEDGER}.new"
        with new.open("wb") as ledger:
            ledger.write(_line({"format": FORMAT, "sweep": self.sweep, "files": self._base}))
            ledger.writelines(_line({"chunk": n, "files": files}) for n, files in sorted(self._chunks.items()))
            if self.complete:
                ledger.write(_line({"complete": len(self._chunks)}))
            ledger.flush()
            os.fsync(ledger.fileno())
        new.replace(self._store / LEDGER)

    def verify(self) -> Set[int]:
        """Return the numbers of the chunks that are finished, whose files are all there, and unchanged.

        Raises
        ------
        SweepError
            Naming the file that is missing or was changed. For values that are missing there is no error: their
            chunk is not finished any more.
        """
        for name, wanted in self._base.items():
            found = checksum(self._store / name)
            if found != wanted:
                what = "is missing" if found is None else "was changed since the sweep wrote it"
                raise SweepError(f"{self._store / name} {what}; delete {self._store}, or give another place")
        for number, files in list(self._chunks.items()):
            for name, wanted in files.items():
                found = checksum(self._store / name)
                if found is None and wanted is not None:
                    self._chunks.pop(number, None)
                    self.complete = False
                elif found != wanted:
                    raise SweepError(
                        f"{self._store / name} was changed since the sweep wrote it; delete this file, "
                        "and its values are evaluated again"
                    )
        return self._chunks.keys()


def checksum(path: Path) -> str | None:
    """Return the checksum of a file; None if there is none."""
    try:
        return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise SweepError(f"{path} cannot be read ({error.strerror}); give another place") from None


def _line(content: Mapping[str, Any]) -> bytes:
    text = json.dumps(content).encode()
    return hashlib.blake2b(text, digest_size=8).hexdigest().encode() + b" " + text + b"\n"


def _content(line: bytes) -> dict[str, Any] | None:
    """Return what a line says; None if it is not as it was written."""
    mark, _, text = line.partition(b" ")
    if hashlib.blake2b(text, digest_size=8).hexdigest().encode() != mark:
        return None
    content: dict[str, Any] = json.loads(text)
    return content
