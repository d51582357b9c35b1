"""What has a client said last, and how does the hand move between its frames?"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tensionlab.demand import Floats
from tensionlab.haptics.bridge.messages import Body, Frame
from tensionlab.haptics.effects.described import effect_of
from tensionlab.haptics.effects.effect import LEAP, Effect

SHORTEST = 1e-3
"""Frames that come closer together, in s, are taken to be so far apart."""
LONGEST = 0.1
"""A gap between frames beyond which a hand does not move evenly from one to the next, in s."""
ONWARD = 1.0
"""How long a hand moves on evenly where the next frame is late, in times between the frames."""
RECENT = 32
"""Frames of which the one that was quickest on its way tells how late the others came."""


@dataclass(frozen=True)
class Arrived:
    """A frame, and when it came, in s."""

    frame: Frame
    time: float


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Where is a body, and how fast?

    Attributes
    ----------
    position, velocity : (d,) arrays
        In m and m/s.
    rotation : (3, 3) array or None
    age : float
        Time since the latest frame that has it, in s.
    """

    position: Floats
    velocity: Floats
    rotation: Floats | None
    age: float


@dataclass
class Mailbox:
    """The latest two frames of whoever commands, and the effects asked for. Used by several threads.

    Attributes
    ----------
    count : int
        Frames that came.
    stop_wanted : bool
    """

    _lock: threading.Lock = field(default_factory=threading.Lock)
    _frames: tuple[Arrived | None, Arrived | None] = (None, None)
    _ways: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))  # plus what the clocks differ by
    _late: float = 0.0
    _effects: dict[str, Effect] = field(default_factory=dict)
    count: int = 0
    stop_wanted: bool = False

    def put(self, frame: Frame, now: float) -> None:
        """Take a frame; an `EffectError` if an effect cannot be, and then nothing of it counts."""
        effects = None
        if frame.effects is not None:
            effects = {name: effect_of(name, given) for name, given in frame.effects.items()}
        with self._lock:
            self._frames = (self._frames[1], Arrived(frame, now))
            self._ways.append(now - frame.time)
            self._late = self._ways[-1] - min(self._ways)
            self.count += 1
            if effects is not None:
                self._effects = effects

    @property
    def effects(self) -> Mapping[str, Effect]:
        """What is to be felt, by the client's names."""
        return self._effects

    def age(self, now: float) -> float:
        """Time since the latest frame, in s; infinite before the first."""
        latest = self._frames[1]
        return float("inf") if latest is None else max(now - latest.time, 0.0)

    def motion(self, name: str, now: float) -> BodyMotion | None:
        """Where is a body now? None if no frame tells.

        Between two frames it moves evenly, one frame behind: from the older place, where it is taken to be when
        the newer frame comes, to the newer one. By the client's clock: a frame that came later than others did
        finds it further on, and where the next is late, it moves on for as long again. Were it to wait and to leap
        with each frame, its speed would be far off. After that it is at the newer place.
        """
        before, latest = self._frames
        if latest is None or name not in latest.frame.bodies:
            return None
        body, age = latest.frame.bodies[name], max(now - latest.time, 0.0)
        here = np.array(body.position)
        still = BodyMotion(here, np.zeros_like(here), _matrix(body), age)
        if before is None or name not in before.frame.bodies:
            return still
        there = np.array(before.frame.bodies[name].position)
        apart = max(latest.frame.time - before.frame.time, SHORTEST)
        share = (age + self._late) / apart
        if apart > LONGEST or share >= 1.0 + ONWARD or there.shape != here.shape:
            return still
        velocity = (here - there) / apart
        if float(np.linalg.norm(velocity)) > LEAP:
            return still
        return BodyMotion(there + share * (here - there), velocity, _matrix(body), age)


def _matrix(body: Body) -> Floats | None:
    """Rotation matrix of a quaternion x, y, z, w; one that is not of length 1 is made so."""
    if body.rotation is None:
        return None
    quaternion = np.array(body.rotation)
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
