"""Parameters of a module: the firmware's own table, what each means, and the check of a value."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from tensionlab import _native
from tensionlab.errors import ProtocolError


@dataclass(frozen=True)
class Parameter:
    """Row of the firmware's table: index in messages, unit, bounds and default."""

    index: int
    unit: str
    lower: float
    upper: float
    default: float


# The firmware's parameters, by name.
PARAMETERS = {row[0]: Parameter(index, *row[1:]) for index, row in enumerate(_native.parameter_table())}
# Parameters that are one of their two bounds.
BINARY_PARAMETERS = frozenset({"timeout_brake", "brake_on_fault", "motor_direction", "calibrated"})
PARAMETER_DESCRIPTIONS = {
    "tension_lower": "minimum tension of an armed module",
    "tension_upper": "the largest tension",
    "slew": "how fast the tension changes at most",
    "newton_per_ampere": "tension for each ampere; calibrated, not computed",
    "friction_coulomb": "dry friction at the cable, compensated",
    "friction_viscous": "friction that grows with speed, compensated",
    "current_continuous": "continuous rating of the winding",
    "current_peak": "peak rating of the winding, held for a while",
    "thermal_time": "time constant of the winding",
    "speed_limit": "reeling in faster, the module pulls less; at 1.4 times it faults",
    "length_lower": "cable that must stay out; shorter, it pulls only with the minimum tension",
    "length_upper": "cable there is; longer, it pulls only with the minimum tension",
    "spool_radius": "from encoder angle to cable length",
    "ttl": "time to live of a set-point that says none",
    "stiffness_limit": "of SET_IMPEDANCE",
    "damping_limit": "of SET_IMPEDANCE",
    "supply_lower": "below it the module faults",
    "supply_upper": "above it the module faults",
    "brake_open_pulse": "of the servo with the pawl lifted; measure it",
    "brake_closed_pulse": "of the servo with the pawl laid on; measure it",
    "brake_travel": "that the servo needs from one to the other; measure it",
    "brake_dwell": "least time between two changes",
    "brake_tooth": "cable from tooth to tooth of the brake's wheel",
    "brake_release_tension": "to reel the load off the pawl before it is lifted",
    "timeout_brake": "what the brake does when the module times out",
    "brake_on_fault": "after a fault, an emergency stop or a start: open for people, closed for loads",
    "motor_direction": "sign of the encoder while the cable pays out",
    "motor_zero": "electrical angle at the encoder's zero; CALIBRATE finds it",
    "calibrated": "whether the module may be armed; CALIBRATE sets it",
}  # what each parameter means


def single(value: float) -> float:
    """Return the 32-bit number that a module stores in place of this one."""
    try:
        stored: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)
    return stored


def require_name(name: str) -> Parameter:
    """Return a parameter by its name; a `ProtocolError` lists the names there are."""
    if name not in PARAMETERS:
        raise ProtocolError(f"modules have no parameter {name!r}; they have {', '.join(PARAMETERS)}")
    return PARAMETERS[name]


def require_value(name: str, value: float, origin: str) -> float:
    """Return a value as a module stores it; a `ProtocolError` says what the bounds are."""
    row, stored = require_name(name), single(value)
    if not row.lower <= stored <= row.upper:
        raise ProtocolError(f"{origin}: {name} is from {row.lower:g} to {row.upper:g} {row.unit}; got {value:g}")
    return stored
