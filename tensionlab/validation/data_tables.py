"""Files of the validation: recordings and directions (Parquet), and published values (TOML).

A recording has a row for each force that a rig rendered on a force sensor; ``datasets/recordings/README.md``
describes the columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from tensionlab.errors import DataError, InputError, ShapeError
from tensionlab.solvers.base import Status
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats, Integers
from tensionlab.support.files.reading import as_path, brief, read_toml
from tensionlab.support.files.tables import read_parquet
from tensionlab.support.validation import validate

if TYPE_CHECKING:
    import pandas

AXES = "xyz"
FORCES = ("desired", "rendered", "measured")
# Columns with one value for each force, and their types.
FORCE_COLUMNS = {"spread": float, "status": str, "fallback_used": bool, "samples": int, "limited_modules": str}
Row = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]


class RecordingEntries(BaseModel):
    """Entries under ``recording`` in a recording's manifest; there may be others."""

    model_config = ConfigDict(extra="allow", strict=True)

    simulated: bool
    rig: str
    modules: list[str]
    solver: str
    sensor: str
    alignment: str  # method that was applied
    rotations: dict[str, Annotated[list[Row], Field(min_length=3, max_length=3)]]  # of each method, sensor to rig
    rate: FiniteFloat  # of the sensor, in Hz
    hold: FiniteFloat  # time for which each force was held, in s

    @model_validator(mode="after")
    def _applied(self) -> Self:
        if self.alignment not in self.rotations:
            raise ValueError(f'there is no rotation "{self.alignment:.40}", which was applied')
        return self


@dataclass(frozen=True, eq=False)
class Recording:
    """Desired and measured forces, K of them, of a rig of m modules, in the rig's axes and in N."""

    desired: Floats  # (K, 3)
    rendered: Floats  # (K, 3) of the chosen tensions by the rig's model
    measured: Floats  # (K, 3) mean of the sensor's samples while the force was held, less its zero
    tensions: Floats  # (K, m) as they were commanded
    spread: Floats  # (K,) standard deviation of the samples along the axis where it is largest
    status: Integers  # (K,) what is proved about the solver's choice: `Status`
    fallback_used: NDArray[np.bool_]  # (K,) whether that was unproven, so that the exact solver's was sent
    samples: Integers  # (K,) number of samples in the mean
    limited_modules: NDArray[np.str_]  # (K,) modules at a limit of their own, with spaces between
    manifest: dict[str, Any]  # that of `provenance.manifest`, and `RecordingEntries` under ``recording``

    def __post_init__(self) -> None:
        count, entries = len(self.desired), _entries(self.manifest)
        shapes: dict[str, tuple[int, ...]] = {"tensions": (count, len(entries.modules))}
        shapes |= dict.fromkeys(FORCES, (count, 3)) | dict.fromkeys(FORCE_COLUMNS, (count,))
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ShapeError(f"a recording's {name} has shape {getattr(self, name).shape}, not {shape}")

    def __repr__(self) -> str:
        return f"<Recording of {self.title}>"

    def to_pandas(self) -> pandas.DataFrame:
        """Return a row for each force, with the columns of the file, such as ``measured.Fx``.

        MissingDependency if pandas is not installed.
        """
        return provenance.data_frame(self.columns()).set_index("vector")

    def columns(self) -> dict[str, Any]:
        """Return the columns of the table by name, a row for each force; `Status` by name."""
        columns: dict[str, Any] = {"vector": np.arange(len(self.desired))}
        for name, parts in _parts(self.manifest["recording"]["modules"]).items():
            columns |= {f"{name}.{part}": getattr(self, name)[:, i] for i, part in enumerate(parts)}
        columns |= {name: getattr(self, name) for name in FORCE_COLUMNS}
        columns["status"] = [Status(code).name for code in self.status]
        return columns

    @property
    def title(self) -> str:
        """Rig, kind, number and size of the forces, and solver."""
        entries = self.manifest["recording"]
        kind = "simulated" if self.simulated else "measured"
        force = float(np.linalg.norm(self.desired, axis=1).mean())
        return f"{entries['rig']}, {kind}: {len(self.desired)} forces of {force:.3g} N, solver {entries['solver']}"

    @property
    def simulated(self) -> bool:
        """Whether no real module pulled."""
        return bool(self.manifest["recording"]["simulated"])

    @property
    def error(self) -> Floats:
        """Measured minus desired force: (K, 3) array in N."""
        return self.measured - self.desired


def write_recording(path: str | Path, recording: Recording) -> None:
    """Write a recording; raise `InputError` unless the file's name says whether it is simulated."""
    if ("simulated" in as_path(path).stem) != recording.simulated:
        word = "simulated, so its name must say" if recording.simulated else "real, so its name must not say"
        raise InputError(f'{path}: the recording is {word} "simulated"')
    provenance.write_parquet(path, recording.columns(), recording.manifest)


def read_recording(path: str | Path) -> Recording:
    """Read a recording; raise `DataError`, which names the column or entry that is missing or wrong."""
    table = read_parquet(path, "a recording of forces (*.parquet)", DataError)
    arrays: dict[str, Any] = {
        name: np.column_stack([table.numbers(f"{name}.{part}", DataError) for part in parts])
        for name, parts in _parts(_entries(table.manifest, f"{path}: ").modules).items()
    }
    arrays |= {
        name: np.array(table.values(name, kind, DataError), dtype=kind) for name, kind in FORCE_COLUMNS.items()
    }
    if unknown := set(arrays["status"]) - set(Status.__members__):
        raise DataError(f"{path}: status is {brief(min(unknown))}; there are {', '.join(Status.__members__)}")
    arrays["status"] = np.array([Status[name] for name in arrays["status"]], dtype=np.int64)
    return Recording(**arrays, manifest=table.manifest)


def _entries(manifest: dict[str, Any], source: str = "") -> RecordingEntries:
    """Return what a manifest says of a recording, checked."""
    if "recording" not in manifest:
        raise DataError(f'{source}the manifest of a recording has no entry "recording"')
    return validate(RecordingEntries, manifest["recording"], DataError, f"{source}manifest of the recording")


def _parts(modules: list[str]) -> dict[str, list[str]]:
    """Return the names of the columns of each force, and of the tensions."""
    return {name: [f"F{axis}" for axis in AXES] for name in FORCES} | {"tensions": list(modules)}


def read_vectors(path: str | Path) -> Floats:
    """Read unit vectors, (K, 3); raise `DataError` if there are none."""
    table = read_parquet(path, "a table of vectors (*.parquet)", DataError)
    return np.column_stack([table.numbers(axis, DataError) for axis in AXES])


@dataclass(frozen=True)
class _Published:
    __pydantic_config__ = ConfigDict(extra="forbid")

    source: str
    values: dict[str, dict[str, FiniteFloat | str]]


def read_published(path: str | Path) -> pandas.DataFrame:
    """Read published values (TOML): a row for each name, the source of them all in ``attrs["source"]``.

    `DataError` says what is missing or unknown.
    """
    file = validate(_Published, read_toml(path, "published values (*.toml)", DataError), DataError, path)
    table = provenance.data_frame([*file.values.values()], [*file.values])
    table.attrs["source"] = file.source
    return table
