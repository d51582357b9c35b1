"""Validation from the first force to the last, in one session or several: its plan, and its journal."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tensionlab.errors import LogError, WriteError
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.runner.settings import RealClock
from tensionlab.model.files import rig_to_toml
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing
from tensionlab.support.files.reading import brief, parse_json, read_text
from tensionlab.support.files.tables import MAX_FILE_BYTES, from_mappings
from tensionlab.validation.error_model import PRESETS, draw_errors, require_point
from tensionlab.validation.protocol import Measurement, Protocol, measure
from tensionlab.validation.sensors import ForceSensor
from tensionlab.validation.simulated_sensor import simulated_setup

JOURNAL_FILE = "measurements.jsonl"
FORMAT = "tensionlab validation 2"


@dataclass(frozen=True, eq=False)
class ValidationPlan:
    """Rig, as it is believed to be, solver and protocol of a validation.

    The preset, a key of `PRESETS`, is what is wrong with the simulated rig; None for real modules, or another
    process's. The seed is of the errors and of the noise.
    """

    rig: Rig
    solver: str
    protocol: Protocol
    preset: str | None = None
    seed: int = 0

    def setup(self, *, simulated: bool) -> dict[str, Any]:
        """Return what must be the same in all sessions; ``simulated`` is as the sensor says of itself."""
        return {
            "rig": rig_to_toml(self.rig),
            "solver": self.solver,
            "hold": self.protocol.hold,
            "settle": self.protocol.settle,
            "force": self.protocol.force,
            "directions": self.protocol.directions.tolist(),
            "simulated": simulated,
            "preset": self.preset,
            "seed": self.seed if self.preset is not None else None,
        }


class Journal:
    """File of JSON lines that resumes an interrupted validation: the setup, and then each measurement.

    What an interrupted validation left in the file is taken over; its setup must not differ. Measurements are in
    the order of their numbers, without a gap. `LogError` names a file that is of another validation, is damaged,
    or can't be read or written.
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
                found, self.measurements = _parse(path, whole)
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


def _parse(path: Path, text: str) -> tuple[dict[str, Any], list[Measurement]]:
    """Return the setup and the measurements of a journal."""
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


def validate(
    plan: ValidationPlan,
    folder: Path,
    opened: tuple[ModuleGroup, ForceSensor] | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[dict[str, Any], list[Measurement]]:
    """Measure what is still to be measured; return the setup, and fewer measurements if a signal ended it.

    A simulated rig is deterministic, and goes through what it did before without recording it again: friction
    remembers, so that each force depends a little on those before. Real modules take up the last force again, and
    go on from there.

    The folder keeps the measurements. ``opened`` are real modules and their sensor, or those of another process;
    without them, they are simulated in this process. ``progress`` receives the share that is done. Raises
    `RigError` if the rig does not hold a point in space, and `HardwareError` for what went wrong with modules,
    sensor or journal.
    """
    require_point(plan.rig)
    writing.make_folder(folder)
    setup = plan.setup(simulated=opened is None or opened[1].simulated)
    journal = Journal(folder / JOURNAL_FILE, setup)
    total = len(plan.protocol.forces)
    before = len(journal.measurements)
    if before == total:
        return setup, journal.measurements

    def keep(measurement: Measurement) -> None:
        journal.add(measurement)
        if progress is not None:
            progress((measurement.number + 1) / total)

    if opened is None:
        assert plan.preset is not None
        errors = draw_errors(PRESETS[plan.preset], plan.rig.m, plan.seed)
        modules, clock, sensor = simulated_setup(plan.rig, errors, plan.seed)
        measure(plan.rig, modules, clock, sensor, plan.solver, plan.protocol, keep)
        modules.close()
    else:
        first = max(before - 1, 0)
        measure(
            plan.rig, opened[0], RealClock(opened[0].clients), opened[1], plan.solver, plan.protocol, keep, first
        )
    return setup, journal.measurements
