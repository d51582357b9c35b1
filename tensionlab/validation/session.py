"""One validation, from the first force to the last: in one sitting, or in several."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tensionlab.files.writing import make_folder
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.runner.settings import RealClock
from tensionlab.model.files import rig_to_toml
from tensionlab.model.rig import Rig
from tensionlab.validation.error_model import PRESETS, draw, require_point
from tensionlab.validation.journal import Journal
from tensionlab.validation.protocol import Measurement, Protocol, measure
from tensionlab.validation.sensor import ForceSensor
from tensionlab.validation.setup import simulated_setup

FILE = "measurements.jsonl"


@dataclass(frozen=True, eq=False)
class Plan:
    """What is validated, and how?

    Attributes
    ----------
    rig : Rig
        As it is believed to be.
    solver : str
    protocol : Protocol
    preset : str or None
        A key of `PRESETS`: what is wrong with the simulated rig. None for real modules, or another process's.
    seed : int
        Of the errors and of the noise.
    """

    rig: Rig
    solver: str
    protocol: Protocol
    preset: str | None = None
    seed: int = 0

    def setup(self, *, simulated: bool) -> dict[str, Any]:
        """What must be the same in all sittings? ``simulated``: as the sensor says of itself."""
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


def validate(
    plan: Plan,
    folder: Path,
    reached: tuple[ModuleGroup, ForceSensor] | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[dict[str, Any], list[Measurement]]:
    """Measure what is still to be measured.

    A simulated rig is deterministic, and goes through what it did before without recording it again: friction
    remembers, so that each force depends a little on those before. Real modules take up the last force again, and
    go on from there.

    Parameters
    ----------
    plan : Plan
    folder : Path
        Keeps the measurements.
    reached : (ModuleGroup, ForceSensor), optional
        Real modules and their sensor, or those of another process; simulated ones of this process if left out.
    progress : callable, optional
        Told the share that is done.

    Returns
    -------
    setup : dict
        As `Plan.setup` says.
    measurements : list of Measurement
        Fewer than there are forces if a signal ended it.

    Raises
    ------
    RigError
        If the rig does not hold a point in space.
    HardwareError
        What went wrong with modules, sensor or journal.
    """
    require_point(plan.rig)
    make_folder(folder)
    setup = plan.setup(simulated=reached is None or reached[1].simulated)
    journal = Journal(folder / FILE, setup)
    total = len(plan.protocol.forces)
    before = len(journal.measurements)
    if before == total:
        return setup, journal.measurements

    def done(measurement: Measurement) -> None:
        journal.add(measurement)
        if progress is not None:
            progress((measurement.number + 1) / total)

    if reached is None:
        assert plan.preset is not None
        errors = draw(PRESETS[plan.preset], plan.rig.m, plan.seed)
        modules, clock, sensor = simulated_setup(plan.rig, errors, plan.seed)
        measure(plan.rig, modules, clock, sensor, plan.solver, plan.protocol, done)
        modules.close()
    else:
        first = max(before - 1, 0)
        measure(plan.rig, reached[0], RealClock(), reached[1], plan.solver, plan.protocol, done, first)
    return setup, journal.measurements
