"""The modules that ``tensionlab simulate`` serves: of a rig, or one by itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from tensionlab.hardware.simulation.serve import read_settings
from tensionlab.hardware.simulation.simulated_module import SimulatedModule
from tensionlab.hardware.simulation.simulated_rig import simulated_module

if TYPE_CHECKING:
    from tensionlab.model.rig import Rig
    from tensionlab.validation.error_model import Errors

ALONE = "module"
"""What a module is called that belongs to no rig."""


def one_module(seed: int, settings_file: Path | None) -> dict[str, tuple[SimulatedModule, Path | None]]:
    """Which module is simulated without a rig? One fresh from its maker: neither set up nor calibrated."""
    module = SimulatedModule(seed=seed, settings=_settings(settings_file))
    _complain(module, settings_file)
    return {ALONE: (module, settings_file)}


def rig_modules(
    rig: Rig,
    seed: int,
    config_file: Path | None,
    far_ends: Mapping[str, Callable[[], float]],
    errors: Errors | None,
) -> dict[str, tuple[SimulatedModule, Path | None]]:
    """Which modules are simulated, and where does each keep its settings?"""
    from tensionlab.validation.error_model import true_plants, true_rig

    plants = {} if errors is None else true_plants(rig, errors)
    if errors is not None:
        rig = true_rig(rig, errors)
    lengths = rig.lengths(rig.home, frames=rig.at_rest)
    simulated = {}
    for index, (each, length) in enumerate(zip(rig.modules, lengths, strict=True)):
        at = config_file and config_file.with_name(f"{config_file.stem}-{index + 1}{config_file.suffix}")
        start = far_ends[each.name]() if far_ends else float(length)
        module = simulated_module(
            each,
            start,
            serial_number=index + 1,
            seed=seed + index,
            settings=_settings(at),
            plant=plants.get(each.name),
        )
        _complain(module, at)
        simulated[each.name] = (module, at)
    return simulated


def _settings(path: Path | None) -> bytes | None:
    return None if path is None else read_settings(path)


def _complain(module: SimulatedModule, path: Path | None) -> None:
    """Say so where a file holds no settings: the module has standard ones then, as a real one would."""
    if path is not None and path.exists() and not module.loaded:
        typer.echo(f"{path}: not the settings of a module; it starts with standard ones", err=True)
