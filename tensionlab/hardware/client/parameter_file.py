"""A module's parameters as a TOML file, and back: checked as a whole before anything is changed.

::

    [module]                                     # for information
    serial_number = 1
    firmware = "0.1"

    [parameters]
    tension_lower = 0.5                          # N, 0.1 to 2: the taut minimum
    ...

A file may leave parameters out; those stay as they are.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tensionlab.errors import HardwareError
from tensionlab.files.reading import brief, parse_toml
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.messages import GetParameter, Info, ParameterValue, SetParameter
from tensionlab.hardware.protocol.parameters import (
    CHOICES,
    PARAMETER_DESCRIPTIONS,
    PARAMETERS,
    require_value,
    single,
)

ROOMIER_MORE = frozenset({"tension_upper", "newton_per_ampere", "current_peak", "length_upper", "supply_upper"})
"""The more of these, the more room for others."""
ROOMIER_LESS = frozenset({"tension_lower", "length_lower", "supply_lower"})
"""The less of these, the more room for others."""
FORGETTING = frozenset({"spool_radius", "motor_direction"})
"""A module that gets another of these no longer knows how long its cable is."""
COLUMN = 34
"""Where the comments begin."""


@dataclass(frozen=True)
class Change:
    """What became of a parameter?"""

    name: str
    before: float
    after: float


def dump(client: ModuleClient) -> str:
    """Which file has the parameters of a module? It must be idle, as for `restore`."""
    info = client.hello()
    lines = [
        "[module] # for information",
        f"serial_number = {info.serial_number}",
        f'firmware = "{firmware(info)}"',
        "",
        "[parameters]",
    ]
    for name, found in parameters(client).items():
        bounds = "" if name in CHOICES else f", {found.lower:g} to {found.upper:g}"
        comment = f"# {PARAMETERS[name].unit}{bounds}: {PARAMETER_DESCRIPTIONS[name]}"
        lines.append(f"{name} = {plain(found.value)}".ljust(COLUMN) + comment)
    return "\n".join([*lines, ""])


def file_of(folder: Path, module: str) -> Path:
    """Return the file in a folder that keeps the parameters of a module: NAME.toml.

    What a file name cannot have, such as a slash, is written as %2F, and a per cent sign as %25.
    """
    return folder / (re.sub(r'[%/\\:*?"<>|\x00-\x1f\x7f]', lambda each: f"%{ord(each[0]):02X}", module) + ".toml")


def restore(client: ModuleClient, text: str, origin: str = "settings") -> list[Change]:
    """Which parameters did a file change? As `parse` and `change` say."""
    return change(client, parse(text, origin), origin)


def parse(text: str, origin: str) -> dict[str, float]:
    """Which values do these settings have?

    Parameters
    ----------
    text : str
        What `dump` gave, or part of it.
    origin : str
        The file, for messages.

    Raises
    ------
    HardwareError
        Naming file and key.
    """
    document = parse_toml(text, origin, HardwareError)
    for key in document:
        if key not in ("module", "parameters"):
            raise HardwareError(f'{origin}: unknown key "{key:.40}"; the file has [module] and [parameters]')
    values = document.get("parameters")
    if not isinstance(values, dict) or not values:
        raise HardwareError(f"{origin}: no parameters; write [parameters] and lines such as slew = 60")
    return checked(values, origin)


def checked(values: Mapping[str, object], origin: str) -> dict[str, float]:
    """Which values would a module have? A `HardwareError` names what is no parameter, or out of bounds."""
    found = {}
    for name, value in values.items():
        if name not in PARAMETERS:
            close = difflib.get_close_matches(name, PARAMETERS)
            advice = (
                f"is it {' or '.join(close)}?"
                if close
                else "`tensionlab module config get MODULE` shows those that they have"
            )
            raise HardwareError(f'{origin}: modules have no parameter "{name:.40}"; {advice}')
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise HardwareError(f"{origin}: {name} is {brief(value)}; give a number")
        row, number = PARAMETERS[name], require_value(name, value, origin)
        if name in CHOICES and number not in (row.lower, row.upper):
            raise HardwareError(f"{origin}: {name} is {row.unit}; got {value:g}")
        found[name] = number
    return found


def change(client: ModuleClient, values: Mapping[str, float], origin: str) -> list[Change]:
    """Which parameters did a module have to change to have these values? It forgets them when it is switched off.

    All values are checked before the first is changed, together with those that stay. They are changed in an order
    in which parameters that bound each other never get in each other's way, and read back.

    Parameters
    ----------
    client : ModuleClient
        Of a module that is idle.
    values : mapping of str to float
        By name; in the parameters' own units.
    origin : str
        Where they come from, for messages.

    Raises
    ------
    HardwareError
        Naming origin and parameter: there is none of that name, or it can't have that value. Nothing is changed.
    ModuleFault, LinkTimeout, LinkError
        The module refuses, because it is not idle; it does not answer; the link broke.
    """
    wanted = checked(values, origin)
    before = {name: found.value for name, found in parameters(client).items()}
    _require_consistent({**before, **wanted}, f'{origin}: module "{client.name}"')

    changes = [Change(name, before[name], number) for name, number in wanted.items() if number != before[name]]
    changes.sort(key=_turn)
    done: list[str] = []
    for each in changes:
        try:
            client.command(SetParameter(PARAMETERS[each.name].index, each.after))
            read_back = client.parameter(each.name)
        except HardwareError as error:
            raise HardwareError(
                f"{error}; until then it took over {', '.join(done) or 'nothing'}, and stored nothing"
            ) from error
        if read_back != each.after:
            raise HardwareError(
                f'module "{client.name}": {each.name} should be {plain(each.after)} now, and is {plain(read_back)}'
            )
        done.append(each.name)
    return changes


def parameters(client: ModuleClient) -> dict[str, ParameterValue]:
    """Which values and bounds has a module?"""
    return {name: client.request(GetParameter(row.index), ParameterValue) for name, row in PARAMETERS.items()}


def firmware(info: Info) -> str:
    """Which firmware is it?"""
    return f"{info.firmware >> 8}.{info.firmware & 0xFF}"


def plain(value: float) -> str:
    """How does one write a module's number, in as few digits as give it back?"""
    return str(np.float32(value))


def _require_consistent(values: Mapping[str, float], origin: str) -> None:
    """As the firmware's own table of parameters has it."""
    forever = single(values["current_continuous"] * values["newton_per_ampere"])
    rules = (
        ("tension_lower", "tension_upper", values["tension_lower"] <= values["tension_upper"]),
        ("tension_lower", "current_continuous times newton_per_ampere", values["tension_lower"] <= forever),
        ("current_continuous", "current_peak", values["current_continuous"] <= values["current_peak"]),
        ("length_lower", "length_upper", values["length_lower"] < values["length_upper"]),
        ("supply_lower", "supply_upper", values["supply_lower"] < values["supply_upper"]),
    )
    for less, more, holds in rules:
        if not holds:
            limit = values.get(more, forever)
            raise HardwareError(f"{origin}: {less} would be {values[less]:g}, but {more} {limit:g}; change either")


def _turn(change: Change) -> int:
    """When is it its turn? First what makes room for others, last what takes it; in between what does both."""
    if change.name not in ROOMIER_MORE | ROOMIER_LESS:
        return 1
    return 0 if (change.after > change.before) == (change.name in ROOMIER_MORE) else 2
