"""Messages of the bridge: one JSON object each. `docs/reference/bridge.md` is generated from this file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, NoReturn

from pydantic import BaseModel, ConfigDict, Field, Strict, field_validator

from tensionlab.errors import MAX_MESSAGE_CHARACTERS, ProtocolError, TensionlabError
from tensionlab.support.validation import describe, validate

PROTOCOL = 3  # version of the messages; a `Welcome` has the server's
MAX_MESSAGE_BYTES = 64 * 1024
MAX_ENTRIES = 16  # bodies of a frame, and effects
HAND = "hand"  # the body that the cables pull on
MAX_COORDINATE_M = 100.0
MAX_CLOCK_S = 1e10  # largest time by a client's clock: seconds since any epoch, but not milliseconds since 1970
MAX_LENGTH_ERROR = 1e-3  # largest deviation of a quaternion's length from 1
MAX_SEQUENCE = 2**53  # programs in any language can count up to this

Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Coordinate = Annotated[Number, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Share = Annotated[Number, Field(ge=-1.0 - MAX_LENGTH_ERROR, le=1.0 + MAX_LENGTH_ERROR)]
Name = Annotated[str, Field(min_length=1, max_length=64)]


class BridgeMessage(BaseModel):
    """Message; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Body(BridgeMessage):
    """Place of a tracked body."""

    position: tuple[Coordinate, ...] = Field(
        min_length=2, max_length=3, description="position in m, in the axes of the rig; two numbers in the plane"
    )
    rotation: tuple[Share, Share, Share, Share] | None = Field(
        None, description="unit quaternion x, y, z, w, its length within 0.001; not turned if left out"
    )

    @field_validator("rotation")
    @classmethod
    def _turns(cls, rotation: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if rotation is not None and abs(math.hypot(*rotation) - 1.0) > MAX_LENGTH_ERROR:
            raise ValueError(f"has the length {math.hypot(*rotation):.4g}; give a unit quaternion x, y, z, w")
        return rotation


class Frame(BridgeMessage):
    """Places of the tracked bodies, and effects to render. At 50 to 120 a second; each gets a `state`."""

    type: Literal["frame"] = "frame"
    sequence: Annotated[int, Strict()] = Field(
        0, ge=0, le=MAX_SEQUENCE, description="any whole number; the answer repeats it"
    )
    time: Number = Field(
        ge=-MAX_CLOCK_S,
        le=MAX_CLOCK_S,
        description="when the bodies were there, in s, by the client's own clock, from any beginning; it never "
        "goes back, unless frames have failed to come for 1 s",
    )
    bodies: dict[Name, Body] = Field(
        default_factory=dict,
        max_length=MAX_ENTRIES,
        description="by name: hand is what the cables pull on; others are the frames that modules are attached to",
    )
    effects: dict[Name, dict[str, Any]] | None = Field(
        None,
        max_length=MAX_ENTRIES,
        description="by a name of the client's: kind, and the effect's parameters. One that is missing here "
        "ends; where all this is left out, they stay as they are",
    )


class StopRun(BridgeMessage):
    """End of the run: all modules release their cables."""

    type: Literal["stop"] = "stop"


class Welcome(BridgeMessage):
    """First message to every client."""

    type: Literal["welcome"] = "welcome"
    protocol: int = Field(PROTOCOL, description="version of the messages")
    rig: str = Field(description="its name")
    up: str | None = Field(None, description="axis that points up, such as z or -y; null if the rig does not say")
    modules: list[str] = Field(description="their names, in the order of all lists")
    upper: list[float] = Field(description="largest tension of each module, in N")
    scenario: str | None = Field(None, description="its name, if one is played")
    bodies: list[str] = Field(
        description="names of the bodies whose places the client should send, the hand first"
    )
    rate: float = Field(description="cycles a second, in Hz")
    timeout: float = Field(description="time without a frame after which there is no force any more, in s")


class BridgeState(BridgeMessage):
    """State of the rig: the answer to each `frame`."""

    type: Literal["state"] = "state"
    sequence: int = Field(description="that of the frame; 0 in a stream")
    time: float = Field(
        description="of the run, in s since it began, by the clock of the bridge; shots and other times of "
        "effects, and those of events, are on this clock"
    )
    position: list[float] = Field(description="of the point or the platform, by the cables or the client, in m")
    desired: list[float] = Field(
        description="wrench of the effects as they are, in the latest cycle, in N and N m; what it differs from "
        "measured by is the error that the hand feels. Vibrations that modules render are in neither"
    )
    demanded: list[float] = Field(
        description="what of it is asked of the modules, no stiffer and no faster than the loop renders stably, "
        "in N and N m"
    )
    measured: list[float] = Field(description="wrench of the tensions that the modules report, in N and N m")
    softened: dict[str, dict[str, float]] = Field(
        description="effects that are softer than desired, by name: each such parameter, and the stiffness that "
        "is rendered instead in the latest cycle, in N/m; `frequency` is 0 where a vibration is left out that is "
        "too fast for the host"
    )
    tensions: list[float | None] = Field(description="measured, as the modules report them, in N")
    limiters: list[str] = Field(
        description="what limits each module: NONE, LOWER, UPPER, SLEW, THERMAL, SPEED, LENGTH, RELEASING, "
        "TIMEOUT or IDLE"
    )
    active: list[bool] = Field(description="whether each module takes part")
    rendering: list[bool] = Field(
        description="whether each module renders a spring, damper or vibration at its own rate"
    )
    braked: list[bool] = Field(description="whether each brake is commanded to be on")
    brakes: list[str] = Field(
        description="what each brake does, as far as is known: OPEN, CLOSING, CLOSED, RELEASING, OPENING, UNKNOWN"
    )
    ceiling: float = Field(
        description="host stiffness limit now, in N/m: of what no module renders; the later the loop, the less"
    )
    delay: float = Field(description="loop latency, in s: from a command to the telemetry that shows it")
    fresh: float = Field(description="share of the force that is there: 1, or less where frames fail to come")


KINDS = {
    "fault": "a module has a fault",
    "limit": "something begins to limit a module, or has not limited it for 1 s",
    "lost": "a module does not take part any more",
    "derated": "a module's upper tension limit has changed, to keep its winding from getting too hot",
    "brake": "what a module's brake does, or what a scenario decides about brakes",
    "removed": "a client's effects failed; they are gone, and so is the client's command: why",
    "client": "a client commands, watches, has gone or was refused",
    "refused": "a message over OSC was refused: why",
    "silent": "frames fail to come: there is no force any more",
    "fresh": "frames come again: the force comes in",
    "ceiling": "the host stiffness limit has changed by more than a quarter",
    "stiff": "an effect, or a part of it, is rendered softer than desired, or without its vibration",
    "phase": "a phase of a scenario begins",
    "ended": "the run is over, and why; then the connection closes",
    "rate": "once a second: cycles and frames a second, really",
}  # kinds of events, and what they say


class BridgeEvent(BridgeMessage):
    """Something that happened, for all clients. A `rate`, once a second, goes only to those that watch.

    Keys that do not belong to its kind are left out.
    """

    type: Literal["event"] = "event"
    time: float = Field(description="of the run, in s: on the clock of `time` of the state")
    kind: str = Field(description="one of those below")
    text: str = Field(description="what happened")
    module: str | None = Field(None, description="its name, if it is one module's")
    effect: str | None = Field(None, description="stiff: the effect's name, as the client or the scenario has it")
    stiffness: float | None = Field(None, description="stiff: what was desired, in N/m (of a vibration, in Hz)")
    ceiling: float | None = Field(
        None, description="stiff: what is rendered; ceiling: host stiffness limit, in N/m"
    )
    upper: float | None = Field(None, description="derated: its upper tension limit now, in N")
    delay: float | None = Field(None, description="ceiling: loop latency, in s")
    cycles: float | None = Field(None, description="rate: cycles a second, really")
    gap: float | None = Field(None, description="rate: the longest time from one cycle to the next, in s")
    frames: float | None = Field(None, description="rate: frames a second that came")


class Refused(BridgeMessage):
    """Refusal of a message: the answer to it, in place of a `state`."""

    type: Literal["refused"] = "refused"
    reason: str = Field(description="what is wrong with it, and what to do")


def refusal_reason(error: Exception) -> str:
    """Return in one line why a message was refused."""
    reason = str(error) if isinstance(error, TensionlabError) else f"{type(error).__name__}: {error}"
    return reason.replace(":\n  ", ": ").replace("\n  ", "; ")[:MAX_MESSAGE_CHARACTERS]


IN: tuple[type[Frame], type[StopRun]] = (Frame, StopRun)
OUT: tuple[type[BridgeMessage], ...] = (Welcome, BridgeState, BridgeEvent, Refused)
EXAMPLES: dict[type[BridgeMessage], dict[str, Any]] = {
    Frame: {
        "type": "frame",
        "sequence": 7,
        "time": 12.5,
        "bodies": {"hand": {"position": [0.0, 0.31, 0.0], "rotation": [0.0, 0.0, 0.0, 1.0]}},
        "effects": {
            "floor": {
                "kind": "wall",
                "plane": {"point": [0.0, 0.32, 0.0], "normal": [0.0, 1.0, 0.0]},
                "stiffness": 100.0,
            },
            "air": {"kind": "viscous", "damping": 0.5},
        },
    },
    StopRun: {"type": "stop"},
    Welcome: {
        "type": "welcome",
        "protocol": PROTOCOL,
        "rig": "bartels2026-validation",
        "up": "y",
        "modules": ["floor-1", "floor-2", "floor-3", "top"],
        "upper": [6.0, 6.0, 6.0, 6.0],
        "scenario": None,
        "bodies": ["hand"],
        "rate": 50.0,
        "timeout": 0.25,
    },
    BridgeState: {
        "type": "state",
        "sequence": 7,
        "time": 3.42,
        "position": [0.0, 0.31, 0.0],
        "desired": [0.0, 1.0, 0.0],
        "demanded": [0.0, 1.0, 0.0],
        "measured": [0.0, 1.0, 0.0],
        "softened": {},
        "tensions": [0.5, 0.5, 0.5, 1.7],
        "limiters": ["NONE", "NONE", "NONE", "NONE"],
        "active": [True, True, True, True],
        "rendering": [False, False, False, True],
        "braked": [False, False, False, False],
        "brakes": ["OPEN", "OPEN", "OPEN", "OPEN"],
        "ceiling": 33.0,
        "delay": 0.02,
        "fresh": 1.0,
    },
    BridgeEvent: {
        "type": "event",
        "time": 3.42,
        "kind": "limit",
        "text": "limited by: UPPER",
        "module": "top",
    },
    Refused: {
        "type": "refused",
        "reason": "effect 'floor': stifness is an unknown key; did you mean \"stiffness\"?",
    },
}
"""A complete message of each kind: those of the schema and of docs/reference/bridge.md."""


def parse(content: str | bytes) -> Any:
    """Return what a JSON text holds; `ProtocolError` if it is none, says where."""
    try:
        return json.loads(content, parse_constant=_no_constant)
    except RecursionError:
        raise ProtocolError("not JSON: nested too deep") from None
    except UnicodeDecodeError:
        raise ProtocolError("not JSON: not UTF-8 text") from None
    except json.JSONDecodeError as error:
        what = error.msg[:1].lower() + error.msg[1:]
        raise ProtocolError(f"not JSON: {what}, at character {error.pos + 1}") from None
    except ValueError:  # Python refuses to parse thousands of digits
        raise ProtocolError("not JSON: a whole number has thousands of digits") from None


def _no_constant(word: str) -> NoReturn:
    raise ProtocolError(f"not JSON, which has no {word}: give a finite number, or leave the key out")


def parse_message(given: object) -> Frame | StopRun:
    """Return the message of a client that an object is; `ProtocolError` names the key, and what to give."""
    kinds: dict[str, type[Frame | StopRun]] = {"frame": Frame, "stop": StopRun}
    there = " or ".join(f'"{name}"' for name in kinds)
    if not isinstance(given, Mapping):
        raise ProtocolError(f"a message is {describe(given)}; give an object whose type is {there}")
    if "type" not in given:
        raise ProtocolError(f"type is missing; give {there}")
    kind = given["type"]
    if not isinstance(kind, str) or kind not in kinds:
        raise ProtocolError(f"type is {describe(kind)}; give {there}")
    return validate(kinds[kind], given, ProtocolError)
