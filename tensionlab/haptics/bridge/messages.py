"""Messages of the bridge: one JSON object each. `docs/reference/bridge.md` is generated from this file."""

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal, NoReturn

from pydantic import BaseModel, ConfigDict, Field, Strict, field_validator

from tensionlab.errors import MAX_MESSAGE_CHARACTERS, ProtocolError, TensionlabError
from tensionlab.support.validation import take_kind, validate

PROTOCOL = 3  # version of the messages; a `Welcome` has the server's
MAX_MESSAGE_BYTES = 64 * 1024
MAX_ENTRIES = 16  # bodies, and effects, in a frame
HAND = "hand"  # the body that the cables pull on
MAX_COORDINATE_M = 100.0
MAX_CLOCK_S = 1e10  # largest time by a client's clock: seconds since any epoch, but not milliseconds since 1970
MAX_LENGTH_ERROR = 1e-3  # largest deviation of a quaternion's length from 1
MAX_SEQUENCE = 2**53  # largest whole number in JavaScript

Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Coordinate = Annotated[Number, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Share = Annotated[Number, Field(ge=-1.0 - MAX_LENGTH_ERROR, le=1.0 + MAX_LENGTH_ERROR)]
Name = Annotated[str, Field(min_length=1, max_length=64)]


class BridgeMessage(BaseModel):
    """Message; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class BodyPose(BridgeMessage):
    """Pose of a tracked body."""

    position: tuple[Coordinate, ...] = Field(
        min_length=2,
        max_length=3,
        description="position in m, in the axes of the rig; two numbers on a planar rig",
    )
    rotation: tuple[Share, Share, Share, Share] | None = Field(
        None, description="unit quaternion x, y, z, w, its length within 0.001; no rotation if left out"
    )

    @field_validator("rotation")
    @classmethod
    def _require_unit(cls, rotation: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if rotation is not None and abs(math.hypot(*rotation) - 1.0) > MAX_LENGTH_ERROR:
            raise ValueError(f"has the length {math.hypot(*rotation):.4g}; give a unit quaternion x, y, z, w")
        return rotation


class Frame(BridgeMessage):
    """Poses of the tracked bodies, and effects to render, 50 to 120 times a second; each gets a `state`."""

    type: Literal["frame"] = "frame"
    sequence: Annotated[int, Strict()] = Field(
        0, ge=0, le=MAX_SEQUENCE, description="any whole number; the answer repeats it"
    )
    time: Number = Field(
        ge=-MAX_CLOCK_S,
        le=MAX_CLOCK_S,
        description="time of the poses, in s, on the client's own clock with any origin; it never decreases, "
        "unless no frame has come for 1 s",
    )
    bodies: dict[Name, BodyPose] = Field(
        default_factory=dict,
        max_length=MAX_ENTRIES,
        description="by name: `hand` is what the cables pull; others are frames that modules are attached to",
    )
    effects: dict[Name, dict[str, Any]] | None = Field(
        None,
        max_length=MAX_ENTRIES,
        description="by a name of the client's choice: kind, and the effect's parameters. An effect that is "
        "missing ends; if `effects` is left out, they stay as they are",
    )


class StopRun(BridgeMessage):
    """End of the run: all modules release their cables."""

    type: Literal["stop"] = "stop"


class Welcome(BridgeMessage):
    """First message to every client."""

    type: Literal["welcome"] = "welcome"
    protocol: int = Field(PROTOCOL, description="version of the messages")
    rig: str = Field(description="its name")
    up: str | None = Field(None, description="axis that points up, such as z or -y; null if unknown")
    modules: list[str] = Field(description="their names, in the order of all lists")
    upper: list[float] = Field(description="largest tension of each module, in N")
    scenario: str | None = Field(None, description="its name, if one is played")
    bodies: list[str] = Field(description="names of the bodies whose poses the client should send, the hand first")
    rate: float = Field(description="rate of cycles, in Hz")
    timeout: float = Field(description="time without a frame after which the force is 0, in s")


class BridgeState(BridgeMessage):
    """State of the rig: the answer to each `frame`."""

    type: Literal["state"] = "state"
    sequence: int = Field(description="that of the frame; 0 in a stream")
    time: float = Field(
        description="time of the run, in s since it began, by the clock of the bridge; also of shots and other "
        "times of effects, and of events"
    )
    position: list[float] = Field(description="of the point or the platform, by the cables or the client, in m")
    desired: list[float] = Field(
        description="wrench of the effects at their own stiffness, in the latest cycle, in N and N m; its "
        "difference from measured is the rendered error. Vibrations that modules render are in neither"
    )
    demanded: list[float] = Field(
        description="the part demanded of the modules, after the limits of stability and rate, in N and N m"
    )
    measured: list[float | None] = Field(
        description="wrench of the tensions that the modules report, in N and N m; null while one is not known"
    )
    softened: dict[str, dict[str, float]] = Field(
        description="effects that are softer than desired, by name: each such parameter, and the stiffness "
        "rendered in the latest cycle, in N/m; `frequency` is 0 if a vibration is left out because it is too fast "
        "for the host"
    )
    fidelity: dict[str, dict[str, float]] = Field(
        description="fidelity of each active effect over the latest 400 cycles, once a second: the known numbers "
        "of `tensionlab.haptics.rendering.fidelity.Fidelity`, such as stiffness, error_jnd and oscillation"
    )
    noticed: dict[str, list[str]] = Field(description="deviations that a person would notice, in words")
    tensions: list[float | None] = Field(
        description="as the modules report them, in N; null where the report is old"
    )
    limiters: list[str] = Field(
        description="limiter of each module: NONE, LOWER, UPPER, SLEW, THERMAL, SPEED, LENGTH, RELEASING, TIMEOUT "
        "or IDLE"
    )
    active: list[bool] = Field(description="whether each module takes part")
    rendering: list[bool] = Field(
        description="whether each module renders a spring, damper or vibration at its own rate"
    )
    braked: list[bool] = Field(description="whether each brake is commanded to be on")
    brakes: list[str] = Field(
        description="state of each brake: OPEN, CLOSING, CLOSED, RELEASING, OPENING, UNKNOWN"
    )
    ceiling: float = Field(
        description="host stiffness limit now, in N/m, for effects that no module renders; less in a later loop"
    )
    delay: float = Field(description="loop latency, in s: from a command to the telemetry that shows it")
    fresh: float = Field(description="share of the force that is rendered: 1, or less while no frames come")


KINDS = {
    "fault": "a module has a fault",
    "limit": "a module becomes limited, or has not been limited by this for 1 s",
    "lost": "a module no longer takes part",
    "derated": "a module's upper tension limit has changed, to protect its winding from heat",
    "brake": "a module's brake changes its state, or a scenario decides about brakes",
    "removed": "a client's effects failed: they are removed, and the client loses the command; with the reason",
    "client": "a client commands, watches, has disconnected or was refused",
    "refused": "a message over OSC was refused; with the reason",
    "silent": "no frames come: the force is 0",
    "fresh": "frames come again: the force fades in",
    "ceiling": "the host stiffness limit has changed by more than a quarter",
    "stiff": "a parameter of an effect is rendered softer than desired, by another amount, or as desired again",
    "phase": "a phase of a scenario begins",
    "ended": "the run has ended; with the reason. Then the connection closes",
    "rate": "once a second: measured rates of cycles and frames",
}  # kinds of events, and their meanings


class BridgeEvent(BridgeMessage):
    """Event of the run, for all clients; a `rate`, once a second, only for those that watch.

    Keys that do not belong to its kind are left out.
    """

    type: Literal["event"] = "event"
    time: float = Field(description="time of the run, in s, on the clock of the state's `time`")
    kind: str = Field(description="one of the kinds below")
    text: str = Field(description="description in words")
    module: str | None = Field(None, description="name of the module, if it concerns one")
    effect: str | None = Field(None, description="stiff: name of the effect, by the client or the scenario")
    stiffness: float | None = Field(None, description="stiff: desired value of the parameter, such as N/m")
    ceiling: float | None = Field(None, description="stiff: rendered value; ceiling: host stiffness limit, in N/m")
    upper: float | None = Field(None, description="derated: upper tension limit now, in N")
    delay: float | None = Field(None, description="ceiling: loop latency, in s")
    cycles: float | None = Field(None, description="rate: measured cycles per second")
    gap: float | None = Field(None, description="rate: longest time between two cycles, in s")
    frames: float | None = Field(None, description="rate: received frames per second")


class Refused(BridgeMessage):
    """Refusal of a message, in place of a `state`."""

    type: Literal["refused"] = "refused"
    reason: str = Field(description="what is wrong with it, and what to do")


def refusal_reason(error: Exception) -> str:
    """Return in one line why a message was refused."""
    reason = str(error) if isinstance(error, TensionlabError) else f"{type(error).__name__}: {error}"
    return reason.replace(":\n  ", ": ").replace("\n  ", "; ")[:MAX_MESSAGE_CHARACTERS]


IN: tuple[type[Frame], type[StopRun]] = (Frame, StopRun)
OUT: tuple[type[BridgeMessage], ...] = (Welcome, BridgeState, BridgeEvent, Refused)


def parse(content: str | bytes) -> Any:
    """Return the value of a JSON text; `ProtocolError` says where it is none."""

    def refuse(word: str) -> NoReturn:
        raise ProtocolError(f"not JSON, which has no {word}: give a finite number, or leave the key out")

    try:
        return json.loads(content, parse_constant=refuse)
    except (RecursionError, ValueError) as error:  # of thousands of digits, too
        raise ProtocolError(f"not JSON: {error}") from None


def parse_message(given: object) -> Frame | StopRun:
    """Return the message of a client; `ProtocolError` names the key, and what to give."""
    try:
        kind, _ = take_kind(given, {"frame": Frame, "stop": StopRun}, "type")
    except ValueError as error:
        raise ProtocolError(f"the message {error}") from None
    message: Frame | StopRun = validate(kind, given, ProtocolError)
    return message
