"""What the numbers of the firmware mean, in words, for its documents and whoever shows them."""

from __future__ import annotations

from enum import IntEnum, IntFlag

from tensionlab.hardware.protocol.codes import BrakeState, Calibration, Code, Fault, Limit, ResetReason, State

EVENTS = ("arm", "set-point", "stop", "estop", "clear", "expire", "fault")
"""The supervisor's events, in the order of the firmware's table."""

DESCRIPTIONS: dict[type[IntEnum | IntFlag], dict[str, str]] = {
    Code: {
        "OK": "done",
        "UNKNOWN_TYPE": "no such command in this firmware",
        "BAD_LENGTH": "the payload has another length than the command's",
        "BAD_VALUE": "a number is not finite, out of its bounds, or at odds with another parameter",
        "BAD_STATE": "not in this state, or not while the module is busy with something else",
        "BAD_SESSION": "the session is not the one that armed the module, or has armed it before",
        "STALE": "the sequence number is not after that of the last set-point (never sent: such a one is dropped)",
        "NOT_CALIBRATED": "N/A is not calibrated; or a spring was asked for and the cable's length is not known",
        "FAULT_PRESENT": "something is wrong with the hardware now; see the faults",
        "UNKNOWN_PARAMETER": "no parameter has this index",
        "FAILED": "it was tried, and did not work",
    },
    State: {
        "IDLE": "driver off; settings can be changed",
        "ARMED": "pulls with the taut minimum and waits for the first set-point",
        "RUNNING": "follows set-points",
        "TIMEOUT": "no set-point came in time, or the link closed: lets go in two stages",
        "FAULT": "something broke while the motor was driven: driver off at once",
        "ESTOP": "emergency stop: driver off at once",
    },
    Limit: {
        "NONE": "nothing",
        "LOWER": "the taut minimum, `tension_lower`",
        "UPPER": "`tension_upper`",
        "SLEW": "`slew`: on its way to what is wanted",
        "THERMAL": "the winding's budget: `current_continuous`, `current_peak`, `thermal_time`",
        "SPEED": "the cable reels in faster than `speed_limit`",
        "LENGTH": "the cable is as short or as long as it may be: `length_lower`, `length_upper`",
        "RELEASING": "the brake is being released: at least `brake_release_tension`",
        "TIMEOUT": "the module timed out",
        "IDLE": "the driver is off, or going off",
    },
    Fault: {
        "ENCODER": "parity, error flag, magnet out of range, or a sensor's number is not finite",
        "SUPPLY": "outside `supply_lower` to `supply_upper`; the cut of the motor supply looks like this",
        "SPEED": "reels in at more than twice `speed_limit`",
        "CURRENT": "measured above `current_peak` by half as much again, or none flows though it is asked for",
        "LOOP": "a step came more than 5 ms after the one before",
    },
    Calibration: {
        "LENGTH": "the cable is `value` m long now; not stored",
        "NEWTON_PER_AMPERE": "measured: `value` N/A; from then on the module counts as calibrated",
        "ENCODER": "find the motor's electrical zero; takes some 3 s and turns the spool by a pole pair; "
        "`value` is ignored",
    },
    BrakeState: {
        "OPEN": "lifted",
        "CLOSING": "the servo is on its way down",
        "CLOSED": "laid on: the cable reels in but does not pay out",
        "RELEASING": "reels in, to take the load off the pawl",
        "OPENING": "the servo is on its way up",
    },
    ResetReason: {
        "POWER": "it was switched on",
        "SOFTWARE": "it was told to",
        "WATCHDOG": "its loop hung",
        "BROWNOUT": "its supply sank",
        "OTHER": "the reset button, a crash, or unknown",
    },
}
"""What each code, state, limit, fault and so on means."""

PARAMETER_DESCRIPTIONS = {
    "tension_lower": "the taut minimum: what an armed module pulls with at least",
    "tension_upper": "what it pulls with at most",
    "slew": "how fast the tension changes at most",
    "newton_per_ampere": "tension for each ampere; calibrated, not computed",
    "friction_coulomb": "dry friction at the cable, compensated",
    "friction_viscous": "friction that grows with speed, compensated",
    "current_continuous": "current that the winding stands for ever",
    "current_peak": "current that it stands for a while",
    "thermal_time": "time constant of the winding",
    "speed_limit": "reeling in faster than this, the module pulls less, and at twice this it faults",
    "length_lower": "cable that must stay out; shorter, it pulls only with the taut minimum",
    "length_upper": "cable there is; longer, it pulls only with the taut minimum",
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
    "motor_direction": "sign of the encoder while the cable pays out",
    "motor_zero": "electrical angle at the encoder's zero; CALIBRATE finds it",
    "calibrated": "whether the module may be armed; CALIBRATE sets it",
}
"""What each parameter of a module is."""
