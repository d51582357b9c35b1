"""The modules of a rig, simulated: each with its cable at home, its limits and its brake."""

from __future__ import annotations

from collections.abc import Mapping

from tensionlab.errors import HardwareError
from tensionlab.hardware.protocol.codes import Calibration, Code
from tensionlab.hardware.protocol.frames import Decoder
from tensionlab.hardware.protocol.messages import Acknowledge, Calibrate, Message, SetParameter, read
from tensionlab.hardware.protocol.parameters import PARAMETERS, require_value
from tensionlab.hardware.simulation.simulated_module import PLANT, STEP_S, SimulatedModule
from tensionlab.model.module import Module


def plant_of(module: Module) -> dict[str, float]:
    """What is the hardware of a rig's module made of, where that is not as in `PLANT`?"""
    spool = PLANT["radius"].standard if module.spool_radius is None else module.spool_radius
    return {
        "radius": spool,
        "torque_constant": newton_per_ampere(module) * spool,
        "brake_strength": 0.0 if module.brake is None else module.brake,
    }


def simulated_module(
    module: Module,
    length: float,
    *,
    serial_number: int = 1,
    seed: int = 0,
    settings: bytes | None = None,
    plant: Mapping[str, float] | None = None,
) -> SimulatedModule:
    """What would a module of a rig do?

    It is set up as a maker would leave it: calibrated, and with the rig's limits. Stored settings take the place
    of all that but the cable's length, which no module remembers.

    Parameters
    ----------
    module : Module
        Of the rig. What it does not say is as in `PLANT`; without ``brake`` it has none.
    length : float
        Of its cable, in m.
    serial_number, seed, settings
        As in `SimulatedModule`.
    plant : mapping of str to float, optional
        What the hardware really is where it is not as the rig says; the firmware does not know of it.

    Raises
    ------
    HardwareError
        Naming the module, for what no module of this kind can do.
    """
    built = plant_of(module)
    made = built | ({} if plant is None else dict(plant))
    simulated = SimulatedModule(serial_number, plant=made, distance=length, seed=seed, settings=settings)
    simulated.advance(STEP_S)  # before its first step, a module knows nothing
    commands: list[Message] = []
    if not simulated.loaded:
        taut = PARAMETERS["tension_lower"]
        wanted = {
            "length_upper": max(PARAMETERS["length_upper"].standard, 2.0 * length),
            "tension_upper": module.upper,
            "tension_lower": min(max(module.lower, taut.lower), taut.upper),
            "spool_radius": built["radius"],
        }
        origin = f'module "{module.name}"'
        for name, value in wanted.items():
            commands.append(SetParameter(PARAMETERS[name].index, require_value(name, value, origin)))
        commands.append(Calibrate(Calibration.NEWTON_PER_AMPERE, newton_per_ampere(module)))
    commands.append(Calibrate(Calibration.LENGTH, length))
    for command in commands:
        _tell(simulated, command, module.name)
    return simulated


def newton_per_ampere(module: Module) -> float:
    """What does the firmware take the module's N/A for?"""
    if module.newton_per_ampere is not None:
        return module.newton_per_ampere
    return PARAMETERS["newton_per_ampere"].standard


def _tell(simulated: SimulatedModule, command: Message, name: str) -> None:
    """Have a command carried out, as if it had come over the link."""
    simulated.receive(command.frame(0).pack())
    for frame in Decoder().feed(simulated.transmit()):
        answer = read(frame)
        if isinstance(answer, Acknowledge) and answer.code is Code.OK:
            return
        raise HardwareError(f'module "{name}" answered {answer} to {command}')
    raise HardwareError(f'module "{name}" did not answer {command}')
