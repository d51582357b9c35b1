"""Write `vectors.json`: one golden frame for each message, that both sides of the link must agree on.

Run it from the root of the repository after a change of the protocol: ``python firmware/vectors.py``.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from tensionlab.hardware.protocol.codes import (
    BrakeState,
    Calibration,
    Code,
    Fault,
    Limit,
    ResetReason,
    State,
    Type,
)
from tensionlab.hardware.protocol.messages import (
    Acknowledge,
    Arm,
    Calibrate,
    Clear,
    ConfigureTelemetry,
    EmergencyStop,
    Event,
    GetParameter,
    Hello,
    Info,
    Log,
    ParameterValue,
    Ping,
    Pong,
    Save,
    SetImpedance,
    SetParameter,
    SetTension,
    Stop,
    Telemetry,
)

FILE = Path(__file__).with_name("vectors.json")
# All numbers are exact in single precision, and together they hold zeros in every place.
MESSAGES = (
    Hello(),
    Arm(session=0x1234, stops=3),
    SetTension(session=0x1234, tension=2.5, brake=False, ttl_ms=0),
    SetTension(session=0x1234, tension=0.5, brake=True, ttl_ms=500, rounds=3),
    SetImpedance(
        session=0x1234,
        rest=0.75,
        stiffness=120.0,
        damping=1.5,
        feed_forward=-0.25,
        amplitude=0.125,
        frequency=80.0,
        phase=0.625,
        brake=False,
        ttl_ms=100,
    ),
    Stop(),
    EmergencyStop(),
    Clear(),
    GetParameter(index=3),
    SetParameter(index=2, value=80.0),
    Save(),
    Calibrate(what=Calibration.LENGTH, value=1.25),
    Calibrate(what=Calibration.NEWTON_PER_AMPERE, value=2.75),
    Calibrate(what=Calibration.ENCODER, value=0.0),
    Ping(echo=0x0123456789ABCDEF),
    ConfigureTelemetry(period_ms=20),
    Info(
        protocol=6,
        firmware=0x0005,
        serial_number=0xDEADBEEF,
        reset_reason=ResetReason.WATCHDOG,
        state=State.IDLE,
        stops=7,
        session=0x1200,
        calibrated=True,
        length_known=False,
        parameters=36,
        ttl_ms=250,
        tension_lower=0.5,
        tension_upper=6.0,
        newton_per_ampere=3.0,
        spool_radius=0.01953125,
        tension_continuous=3.03125,
    ),
    ParameterValue(index=2, value=60.0, lower=10.0, upper=300.0),
    Pong(echo=0x0123456789ABCDEF, time_us=0xFFFFFFF0),
    Telemetry(
        time_us=1_000_000,
        state=State.RUNNING,
        faults=Fault(0),
        limit=Limit.THERMAL,
        sequence=200,
        tension=3.25,
        current=1.0625,
        length=1.5,
        speed=-0.125,
        supply=12.0,
        bearable=3.25,
        winding=88,
        brake=BrakeState.CLOSED,
        bad_frames=2,
        lost_frames=0,
        longest_step_us=260,
    ),
    Acknowledge(command=Type.ARM, code=Code.NOT_CALIBRATED, state=State.IDLE, session=0x1234),
    Event(state=State.FAULT, faults=Fault.ENCODER | Fault.LOOP, limit=Limit.IDLE),
    Log(text="hello"),
)


def vectors() -> str:
    """Return the contents of the file."""
    entries = []
    for index, message in enumerate(MESSAGES):
        sequence = 17 * index % 256
        frame = message.frame(sequence)
        entry = {
            "message": type(message).__name__,
            "type": int(message.type),
            "sequence": sequence,
            "fields": asdict(message),
            "payload": frame.payload.hex(),
            "frame": frame.pack().hex(),
        }
        entries.append(entry)
    return json.dumps(entries, indent=1) + "\n"


if __name__ == "__main__":
    FILE.write_text(vectors())
