"""Parameters of a module as a TOML file, and back: taken over as a whole, or not at all.

A file has [parameters], with lines such as ``tension_lower = 0.5``, and perhaps [module] for information.
Parameters that it leaves out stay as they are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tensionlab.errors import HardwareError, ModuleFault
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import BINARY_PARAMETERS, PARAMETERS, require_value
from tensionlab.hardware.protocol.messages import GetParameter, Info, ParameterValue, SetParameter
from tensionlab.support.files.reading import brief, parse_toml
from tensionlab.support.registry import suggest

# Parameters whose change makes a module forget its cable's length.
LENGTH_PARAMETERS = frozenset({"spool_radius", "motor_direction"})
COMMENT_COLUMN = 34


@dataclass(frozen=True)
class Change:
    """Parameter that was changed."""

    name: str
    before: float
    after: float


def dump(client: ModuleClient) -> str:
    """Return the file with the parameters of a module, which must be idle."""
    info = client.hello()
    lines = [
        "[module] # for information",
        f"serial_number = {info.serial_number}",
        f'firmware = "{firmware(info)}"',
        "",
        "[parameters]",
    ]
    for name, parameter in parameters(client).items():
        bounds = "" if name in BINARY_PARAMETERS else f", {parameter.lower:g} to {parameter.upper:g}"
        comment = f"# {PARAMETERS[name].unit}{bounds}: {PARAMETERS[name].meaning}"
        lines.append(f"{name} = {plain(parameter.value)}".ljust(COMMENT_COLUMN) + comment)
    return "\n".join([*lines, ""])


def parse(text: str, origin: str) -> dict[str, float]:
    """Return the values in a text of `dump`, or part of it; a `HardwareError` names origin and key."""
    document = parse_toml(text, origin, HardwareError)
    values = document.get("parameters")
    if not isinstance(values, dict) or not values or document.keys() - {"module", "parameters"}:
        raise HardwareError(f"{origin}: give [parameters] with lines such as slew = 60, and [module] at most")
    return checked(values, origin)


def checked(values: Mapping[str, object], origin: str) -> dict[str, float]:
    """Return values as a module stores them; a `HardwareError` names what is unknown or out of bounds."""
    stored = {}
    for name, value in values.items():
        if name not in PARAMETERS:
            advice = suggest(name, PARAMETERS, "`tensionlab module config get MODULE` shows them all")
            raise HardwareError(f'{origin}: modules have no parameter "{name:.40}"; {advice}')
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise HardwareError(f"{origin}: {name} is {brief(value)}; give a number")
        row, stored[name] = PARAMETERS[name], require_value(name, value, origin)
        if name in BINARY_PARAMETERS and stored[name] not in (row.lower, row.upper):
            raise HardwareError(f"{origin}: {name} is {row.unit}; got {value:g}")
    return stored


def change(client: ModuleClient, values: Mapping[str, float], origin: str) -> list[Change]:
    """Set the parameters of an idle module, until it is switched off, and return those that changed.

    Parameters bound each other, so those that a module refuses are tried again after the others. If it still
    refuses one, the others are changed back, and a `HardwareError` names origin and parameter.
    """
    wanted = checked(values, origin)
    previous = {name: parameter.value for name, parameter in parameters(client).items()}
    changes = [Change(name, previous[name], number) for name, number in wanted.items() if number != previous[name]]
    pending, done = deque(changes), list[Change]()
    refused = 0  # in a row
    while pending:
        change = pending.popleft()
        try:
            client.command(SetParameter(PARAMETERS[change.name].index, change.after))
        except HardwareError as error:
            refused += 1
            if isinstance(error, ModuleFault) and refused <= len(pending):
                pending.append(change)
                continue
            for applied in reversed(done):
                with suppress(HardwareError):
                    client.command(SetParameter(PARAMETERS[applied.name].index, applied.before))
            hint = "; does it fit the other limits?" if isinstance(error, ModuleFault) else ""
            raise HardwareError(f"{origin}: {change.name} = {plain(change.after)}: {error}{hint}") from error
        done.append(change)
        refused = 0
    return changes


def parameters(client: ModuleClient) -> dict[str, ParameterValue]:
    """Return the values and bounds of a module's parameters."""
    return {name: client.request(GetParameter(row.index), ParameterValue) for name, row in PARAMETERS.items()}


def firmware(info: Info) -> str:
    """Return the version of the firmware."""
    return f"{info.firmware >> 8}.{info.firmware & 0xFF}"


def plain(value: float) -> str:
    """Return a module's 32-bit number in as few digits as give it back."""
    return str(np.float32(value))
