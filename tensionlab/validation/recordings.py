"""What a force sensor felt while a rig rendered one force after another: the format of such a recording.

One Parquet table, a row for each force. `datasets/recordings/README.md` has its columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab import records
from tensionlab.arrays import Floats, Integers
from tensionlab.errors import ShapeError
from tensionlab.files.reading import brief
from tensionlab.files.tables import read_parquet
from tensionlab.solvers.base import Status

AXES = "xyz"
FORCES = ("desired", "rendered", "measured")
PLAIN = {"spread": float, "status": str, "replaced": bool, "samples": int, "hindered": str}
"""One value for each force, and of which type it is."""
ABOUT = {
    "simulated": bool,
    "rig": str,
    "modules": list,
    "solver": str,
    "sensor": str,
    "alignment": str,
    "rotations": dict,
    "rate": float,
    "hold": float,
}
"""What the manifest says of a recording, and of which type it is."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Which force was felt for each that was asked for, K of them, by a rig of m modules?

    Attributes
    ----------
    desired : (K, 3) array
        Force asked for, in N, in the rig's axes.
    rendered : (K, 3) array
        What the chosen tensions exert by the rig's model, in N.
    measured : (K, 3) array
        Mean of the sensor's samples while the force was held, less its zero, turned to the rig's axes, in N.
    tensions : (K, m) array
        What the modules were told to pull with, in N.
    spread : (K,) array
        Standard deviation of the samples along the axis where it is largest, in N.
    status : (K,) array of `Status`
        What is proved about the solver's choice.
    replaced : (K,) array of bool
        Whether the solver left its choice unproved, so that the exact solver's was sent.
    samples : (K,) array
        How many samples the mean is of.
    hindered : (K,) array of str
        Modules that something kept from pulling as they were told, with spaces between.
    manifest : dict
        That of `tensionlab.records`, and under ``recording`` the entries of `ABOUT`: whether it is simulated, the
        rig and its modules by name, the solver, the sensor, the rotations from the sensor's axes to the rig's by
        method (3 x 3) and which of them was applied (``alignment``), the sensor's rate in Hz, the hold in s.
    """

    desired: Floats
    rendered: Floats
    measured: Floats
    tensions: Floats
    spread: Floats
    status: Integers
    replaced: NDArray[np.bool_]
    samples: Integers
    hindered: NDArray[np.str_]
    manifest: dict[str, Any]

    def __post_init__(self) -> None:
        about = _about(self.manifest)
        count, modules = len(self.desired), len(about["modules"])
        shapes: dict[str, tuple[int, ...]] = {"tensions": (count, modules)}
        shapes |= dict.fromkeys(FORCES, (count, 3)) | dict.fromkeys(PLAIN, (count,))
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ShapeError(f"a recording's {name} has shape {getattr(self, name).shape}, not {shape}")

    @property
    def simulated(self) -> bool:
        """Whether no real module pulled."""
        return bool(self.manifest["recording"]["simulated"])

    @property
    def error(self) -> Floats:
        """Force that was felt minus the one asked for: (K, 3) array in N."""
        return self.measured - self.desired

    def in_sensor_axes(self) -> Floats:
        """Mean of the samples, less the zero, in the sensor's own axes: (K, 3) array in N."""
        about = self.manifest["recording"]
        rotation: Floats = np.array(about["rotations"][about["alignment"]], dtype=np.float64)
        return self.measured @ rotation


def write(path: str | Path, recording: Recording) -> None:
    """Write a recording.

    Raises
    ------
    ShapeError
        If it is simulated and the file's name does not say so, or the other way round.
    """
    if ("simulated" in Path(path).stem) != recording.simulated:
        word = "simulated, so its name must say" if recording.simulated else "real, so its name must not say"
        raise ShapeError(f'{path}: the recording is {word} "simulated"')
    columns: dict[str, Any] = {"vector": np.arange(len(recording.desired))}
    for name, parts in _parts(recording.manifest["recording"]["modules"]).items():
        columns |= {f"{name}.{part}": getattr(recording, name)[:, i] for i, part in enumerate(parts)}
    columns |= {name: getattr(recording, name) for name in PLAIN}
    columns["status"] = [Status(each).name for each in recording.status]
    records.write_parquet(path, columns, recording.manifest)


def read(path: str | Path) -> Recording:
    """Which recording is in a file?

    Raises
    ------
    ShapeError
        If there is none; says which column or entry is missing.
    """
    table = read_parquet(path, "a recording of forces (*.parquet)", ShapeError)
    try:
        about = _about(table.manifest)
    except ShapeError as error:
        raise ShapeError(f"{path}: {error}") from None
    arrays: dict[str, Any] = {
        name: np.column_stack([table.numbers(f"{name}.{part}", ShapeError) for part in each])
        for name, each in _parts(about["modules"]).items()
    }
    arrays |= {name: np.array(table.values(name, kind, ShapeError), dtype=kind) for name, kind in PLAIN.items()}
    if unknown := set(arrays["status"]) - set(Status.__members__):
        raise ShapeError(f"{path}: status is {brief(min(unknown))}; there are {', '.join(Status.__members__)}")
    arrays["status"] = np.array([Status[name] for name in arrays["status"]], dtype=np.int64)
    try:
        return Recording(**arrays, manifest=table.manifest)
    except ShapeError as error:
        raise ShapeError(f"{path}: {error}") from None


def _about(manifest: Mapping[str, Any]) -> Mapping[str, Any]:
    """What a manifest says of a recording, checked."""
    about = manifest.get("recording")
    if not isinstance(about, Mapping):
        raise ShapeError('the manifest of a recording has no entry "recording"')
    for name, kind in ABOUT.items():
        value = about.get(name)
        if not isinstance(value, kind) and not (kind is float and isinstance(value, int)):
            raise ShapeError(f'the manifest of a recording needs recording["{name}"], a {kind.__name__}')
    if not all(isinstance(each, str) for each in about["modules"]):
        raise ShapeError("the manifest of a recording names modules by something that is no text")
    for name, rotation in about["rotations"].items():
        try:
            sound = np.isfinite(matrix := np.array(rotation, dtype=np.float64)).all() and matrix.shape == (3, 3)
        except (TypeError, ValueError):
            sound = False
        if not sound:
            raise ShapeError(f'the recording\'s rotation "{name:.40}" is no matrix of 3 x 3 numbers')
    if about["alignment"] not in about["rotations"]:
        raise ShapeError(f'the recording has no rotation "{about["alignment"]:.40}", which was applied')
    return about


def _parts(modules: list[str]) -> dict[str, list[str]]:
    """What the numbers of one force, and of one set of tensions, are called."""
    return {name: [f"F{axis}" for axis in AXES] for name in FORCES} | {"tensions": list(modules)}
