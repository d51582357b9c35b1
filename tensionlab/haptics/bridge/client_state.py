"""State of the client: its latest frames and effects, and how the hand moves between the frames."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tensionlab.errors import RigError
from tensionlab.haptics.bridge.command import Command, Commander, FrameRefused
from tensionlab.haptics.bridge.messages import HAND, BodyPose, Frame
from tensionlab.haptics.effects.effect import MAX_HAND_SPEED_M_S, Effect
from tensionlab.haptics.effects.parsing import parse_effect
from tensionlab.model import pose
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

MIN_FRAME_GAP_S = 1e-3  # shortest time between frames for a velocity
MAX_FRAME_GAP_S = 0.1  # after a longer gap the hand is at rest at its new position
EXTRAPOLATION = 1.0  # how long the hand moves on if the next frame is late, in times between the frames
MIN_CABLE_LENGTH_M = 1e-3  # at its anchor a cable has no direction
RESTART_S = 1.0  # time without a frame after which a client's clock may start afresh
DELAY_FRAMES = 32  # recent frames, of which the fastest in transit shows the delay of the others


class ReceivedFrame(NamedTuple):
    """Frame, and the time of its arrival in s."""

    frame: Frame
    time: float


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Position and velocity (d,) of a body in m and m/s, and its rotation.

    The rotation is a matrix (3, 3), in the plane an angle () in rad, or None.
    """

    position: Floats
    velocity: Floats
    rotation: Floats | None


class ClientState:
    """Latest two frames of the client in command, and its effects. Used by several threads.

    ``clock`` is the clock of the bridge, in s: for arrivals of frames and silence of clients; ``count`` the number
    of frames received, ``stop_requested`` whether a client has ended the run.
    """

    def __init__(self, rig: Rig, clock: Callable[[], float] = time.perf_counter) -> None:
        import scipy.spatial.transform  # noqa: F401 - here: no cycle may wait for its import

        self.rig, self.clock, self.command = rig, clock, Command()
        self.count, self.stop_requested = 0, False
        self._lock = threading.Lock()
        self._commander: Commander | None = None
        self._tables: dict[str, dict[str, Any]] = {}
        self._effects: dict[str, Effect] = {}
        self._frames: tuple[ReceivedFrame | None, ReceivedFrame | None] = (None, None)
        self._transit_times: deque[float] = deque(maxlen=DELAY_FRAMES)  # plus the difference of the clocks
        self._late = 0.0

    def put(self, frame: Frame, now: float, commander: Commander | None = None) -> None:
        """Apply a frame; a refused one changes nothing.

        The first frame of another client starts afresh: its hand has not moved, and no effects remain. ``now`` is
        the time of its arrival, in s; without a commander it is from this process. `FrameRefused` if the client is
        not in command, the rig has no such bodies, or time goes back; `EffectError` names a wrong parameter.
        """
        _require_in_command(commander)
        self._require_bodies(frame)
        effects = self._parse_effects(frame)
        with self._lock:
            _require_in_command(commander)  # it may have been dismissed meanwhile
            latest = self._frames[1]
            if commander is not self._commander:
                self._commander, self._frames, self._effects, self._tables = commander, (None, None), {}, {}
                self._transit_times.clear()
            elif latest is not None and now - latest.time < RESTART_S and frame.time < latest.frame.time:
                back = f"time is {frame.time:.12g}, before {latest.frame.time:.12g} of the previous frame"
                advice = f"give s by a clock that never goes back, or pause for {RESTART_S:g} s before it does"
                raise FrameRefused(f"{back}; {advice}")
            self._frames = (self._frames[1], ReceivedFrame(frame, now))
            self._transit_times.append(now - frame.time)
            self._late = self._transit_times[-1] - min(self._transit_times)
            self.count += 1
            if effects is not None:
                self._effects, self._tables = effects, frame.effects or {}
            if commander is not None:
                commander.last_seen = now

    def stop(self, now: float, commander: Commander) -> None:
        """End the run; `FrameRefused` if this client is not in command."""
        _require_in_command(commander)
        commander.last_seen, self.stop_requested = now, True

    def dismiss(self, reason: str) -> None:
        """Remove the effects, and dismiss the client in command, with a reason."""
        with self._lock:
            self._effects, self._tables = {}, {}
            self.command.dismiss(reason)

    def _parse_effects(self, frame: Frame) -> dict[str, Effect] | None:
        """Return the effects of a frame; tables that a client repeats are not parsed again."""
        if frame.effects is None:
            return None
        known, previous_tables = self._effects, self._tables
        return {
            name: known[name]
            if name in known and previous_tables.get(name) == table
            else parse_effect(name, table, self.rig)
            for name, table in frame.effects.items()
        }

    def _require_bodies(self, frame: Frame) -> None:
        """Refuse bodies that the rig does not have, of another dimension, or at an anchor."""
        rig = self.rig
        for name, body in frame.bodies.items():
            if name != HAND and name not in rig.frames:
                known = ", ".join([HAND, *rig.frames])
                raise FrameRefused(f"bodies: this rig has no body {name!r}; there are: {known}")
            if (count := len(body.position)) != rig.dimension:
                raise FrameRefused(f"bodies: position of {name!r} has {count} numbers; give {rig.dimension}")
        if not frame.bodies:
            return
        hand, frames = frame.bodies.get(HAND), rig.at_rest
        for name in set(frames) & set(frame.bodies):
            body = frame.bodies[name]
            frames[name] = pose.CoordinateFrame(np.array(body.position), _rotation(body))
        try:
            lengths = rig.lengths(rig.home if hand is None else np.array(hand.position), frames=frames)
        except RigError as error:
            raise FrameRefused(f"bodies: {error}") from None
        if lengths.min() < MIN_CABLE_LENGTH_M:
            module = rig.modules[int(np.argmin(lengths))].name
            raise FrameRefused(f'bodies: module "{module}" has a cable of no length; stay off its anchor')

    @property
    def effects(self) -> Mapping[str, Effect]:
        """Effects to render, by the client's names."""
        return self._effects

    def age(self, now: float) -> float:
        """Return the time since the latest frame, in s; infinite before the first."""
        latest = self._frames[1]
        return math.inf if latest is None else max(now - latest.time, 0.0)

    def motion(self, name: str, now: float) -> BodyMotion | None:
        """Return the motion of a body at a time; None if no frame has it.

        It moves evenly, one frame behind: from the older position, which it has when the newer frame arrives, to
        the newer one, by the client's clock: a frame that was longer in transit than others finds it further on.
        If the next frame is late, it moves on for as long again, and then is at rest at the newer position.
        """
        previous, latest = self._frames
        if latest is None or name not in latest.frame.bodies:
            return None
        body, age = latest.frame.bodies[name], max(now - latest.time, 0.0)
        here = np.array(body.position)
        still = BodyMotion(here, np.zeros_like(here), _rotation(body))
        if previous is None or name not in previous.frame.bodies:
            return still
        there = np.array(previous.frame.bodies[name].position)
        apart = max(latest.frame.time - previous.frame.time, MIN_FRAME_GAP_S)
        share = (age + self._late) / apart
        if apart > MAX_FRAME_GAP_S or share >= 1.0 + EXTRAPOLATION or there.shape != here.shape:
            return still
        velocity = (here - there) / apart
        if float(np.linalg.norm(velocity)) > MAX_HAND_SPEED_M_S:
            return still
        return BodyMotion(there + share * (here - there), velocity, _rotation(body))


def _require_in_command(commander: Commander | None) -> None:
    if commander is not None and commander.dismissed:
        raise FrameRefused(commander.dismissed)


def _rotation(body: BodyPose) -> Floats | None:
    """Return the rotation of a quaternion x, y, z, w: a matrix; in the plane, the angle about z in rad."""
    if body.rotation is None:
        return None
    if len(body.position) == 2:
        return np.array(2.0 * np.arctan2(*body.rotation[2:]))
    from scipy.spatial.transform import Rotation

    matrix: Floats = Rotation.from_quat(body.rotation).as_matrix()
    return matrix
