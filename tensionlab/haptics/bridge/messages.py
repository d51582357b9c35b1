"""What goes over the bridge: one JSON object a message. `BRIDGE.md` is made from this."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from tensionlab.errors import MAX_MESSAGE_CHARACTERS, TensionlabError
from tensionlab.files.reading import brief

PROTOCOL = 1
"""Version of all this; `Welcome` tells the server's."""
LARGEST = 64 * 1024
"""Bytes of a message, at most."""
MANY = 16
"""Bodies, and effects, at most."""
FAR = 100.0
"""Coordinates in m are between minus and plus this."""

CLOCK_S = 1e12
"""Times by a client's clock are between minus and plus this, in s: seconds, of any epoch."""
LAST = 2**53
"""The largest number of a frame, which programs in any language can count up to."""

Coordinate = Annotated[float, Field(ge=-FAR, le=FAR, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]
Name = Annotated[str, Field(min_length=1, max_length=64)]


class Message(BaseModel):
    """A message; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Body(Message):
    """Where a tracked body is."""

    position: tuple[Coordinate, ...] = Field(
        min_length=2, max_length=3, description="in m, in the axes of the rig; two numbers in the plane"
    )
    rotation: tuple[Share, Share, Share, Share] | None = Field(
        None, description="unit quaternion x, y, z, w; not turned if left out"
    )

    @field_validator("rotation")
    @classmethod
    def _turns(cls, rotation: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if rotation is not None and sum(part * part for part in rotation) < 0.25:
            raise ValueError("a unit quaternion has length 1")
        return rotation


class Frame(Message):
    """Where the tracked bodies are, and what the hand is to feel. At 50 to 120 a second; each gets a `State`."""

    type: Literal["frame"] = "frame"
    sequence: int = Field(0, ge=0, le=LAST, description="any number; the answer repeats it")
    time: float = Field(
        ge=-CLOCK_S,
        le=CLOCK_S,
        allow_inf_nan=False,
        description="when the bodies were there, by the client's own clock, in s",
    )
    bodies: dict[Name, Body] = Field(
        default_factory=dict,
        max_length=MANY,
        description="by name: hand is what the cables pull on; others are the frames that modules ride on",
    )
    effects: dict[Name, dict[str, Any]] | None = Field(
        None,
        max_length=MANY,
        description="by a name of the client's: kind, and the effect's parameters; left out, all stay as they are",
    )


class Stop(Message):
    """End the run: all modules let go."""

    type: Literal["stop"] = "stop"


class Welcome(Message):
    """The first message to every client."""

    type: Literal["welcome"] = "welcome"
    protocol: int = PROTOCOL
    rig: str = Field(description="its name")
    modules: list[str] = Field(description="their names, in the order of all lists")
    scenario: str | None = Field(None, description="its name, if one is played")
    bodies: list[str] = Field(
        description="names of the bodies whose places the client should tell, the hand first"
    )
    rate: float = Field(description="cycles a second")
    timeout: float = Field(description="after so many s without a frame there is no force any more")


class State(Message):
    """How the rig is. The answer to each `Frame`."""

    type: Literal["state"] = "state"
    sequence: int = Field(description="that of the frame")
    time: float = Field(description="of the run, in s")
    position: list[float] = Field(description="of the point or the platform, by the cables or the client, in m")
    asked: list[float] = Field(description="wrench that the effects asked for in the latest cycle, in N and N m")
    pulled: list[float] = Field(description="wrench by what the modules say they pull with, in N and N m")
    tensions: list[float | None] = Field(description="what the modules say they pull with, in N")
    limits: list[str] = Field(description="what holds each module back: NONE, LOWER, UPPER, SLEW, ...")
    active: list[bool] = Field(description="whether each module takes part")
    rendering: list[bool] = Field(
        description="whether each module renders a spring, damper or vibration by itself, at its own rate"
    )
    braked: list[bool] = Field(description="whether each brake is asked to be on")
    brakes: list[str] = Field(
        description="what each brake does, as far as is known: OPEN, CLOSING, CLOSED, RELEASING, OPENING, UNKNOWN"
    )
    ceiling: float = Field(
        description="how stiff what no module renders may be now, in N/m; the later the loop, the less"
    )
    delay: float = Field(description="how late the loop is, in s: from what is asked for to what is heard of it")
    fresh: float = Field(description="share of the force that is there: 1, or less where frames fail to come")


KINDS = {
    "fault": "a module has a fault",
    "limit": "something else than before holds a module back",
    "lost": "a module does not take part any more",
    "derated": "a module's upper tension limit has changed, to keep its winding from getting too hot",
    "brake": "what a module's brake does, or what a scenario decides about brakes",
    "removed": "a client's effects failed; they are gone, and so is the client's command: why",
    "ignored": "something that came over OSC was ignored: why, or how much",
    "silent": "frames fail to come: there is no force any more",
    "fresh": "frames come again: the force comes in",
    "ceiling": "how stiff the host may be has changed by more than a quarter",
    "stiff": "an effect, or a part of it, is rendered by the host and softer than it was asked for",
    "phase": "a phase of a scenario begins",
    "ended": "the run is over, and why; then the connection closes",
    "rate": "once a second: cycles and frames a second, really",
}
"""What events tell of."""


class Event(Message):
    """Something that happened; to those who watch, and to who commands. A `rate`, once a second, only to watchers.

    Keys that do not belong to its kind are left out.
    """

    type: Literal["event"] = "event"
    time: float = Field(description="of the run, in s")
    kind: str = Field(description="one of those below")
    text: str = Field(description="what happened")
    module: str | None = Field(None, description="its name, if it is one module's")
    effect: str | None = Field(None, description="stiff: the effect's name, as the client or the scenario has it")
    stiffness: float | None = Field(None, description="stiff: what was asked for, in N/m")
    ceiling: float | None = Field(None, description="stiff, ceiling: what the host renders at most, in N/m")
    upper: float | None = Field(None, description="derated: its upper tension limit now, in N")
    delay: float | None = Field(None, description="ceiling: how late the loop is, in s")
    cycles: float | None = Field(None, description="rate: cycles a second, really")
    gap: float | None = Field(None, description="rate: the longest time from one cycle to the next, in s")
    frames: float | None = Field(None, description="rate: frames a second that came")


class Refused(Message):
    """Why a message came to nothing. The answer to it, in place of a `State`."""

    type: Literal["refused"] = "refused"
    reason: str


def reason_of(error: Exception) -> str:
    """Return in one line why a message could not be taken."""
    if isinstance(error, ValidationError):
        problem = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(step) for step in problem["loc"] if step not in ("frame", "stop"))
        given = "" if problem["type"] in ("missing", "extra_forbidden") else f", not {brief(problem['input'])}"
        reason = f"{where}: {problem['msg']}{given}" if where else problem["msg"]
    elif isinstance(error, TensionlabError):
        reason = str(error)
    elif isinstance(error, ValueError | RecursionError):
        reason = f"not JSON: {error}"
    else:
        reason = f"{type(error).__name__}: {error}"
    return reason[:MAX_MESSAGE_CHARACTERS]


IN: tuple[type[Message], ...] = (Frame, Stop)
OUT: tuple[type[Message], ...] = (Welcome, State, Event, Refused)
