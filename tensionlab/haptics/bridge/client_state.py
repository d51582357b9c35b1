"""State of the client: its latest frames and effects, and how the hand moves between the frames."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from tensionlab.errors import RigError
from tensionlab.haptics.bridge.command import Command, Commander, FrameRefused
from tensionlab.haptics.bridge.messages import HAND, Body, Frame
from tensionlab.haptics.effects.effect import MAX_HAND_SPEED_M_S, Effect
from tensionlab.haptics.effects.parsing import parse_effect
from tensionlab.model import pose
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

MIN_FRAME_GAP_S = 1e-3  # frames that come closer together are taken to be so far apart
MAX_FRAME_GAP_S = 0.1  # a gap beyond which a hand does not move evenly from one frame to the next
EXTRAPOLATION = 1.0  # how long a hand moves on evenly where the next frame is late, in times between the frames
MIN_CABLE_LENGTH_M = 1e-3  # at its anchor a cable has no direction
RESTART_S = 1.0  # time without a frame after which a client's clock may begin anew
DELAY_FRAMES = 32  # frames of which the one that was quickest on its way shows how late the others came


class Arrived(NamedTuple):
    """Frame, and when it came, in s."""

    frame: Frame
    time: float


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """Motion of a body.

    Attributes
    ----------
    position, velocity : (d,) arrays
        In m and m/s.
    rotation : (3, 3) array, (), an angle in the plane in rad, or None
    """

    position: Floats
    velocity: Floats
    rotation: Floats | None


@dataclass
class ClientState:
    """Latest two frames of the client that commands, and its effects. Used by several threads.

    Parameters
    ----------
    rig : Rig
        Whose bodies there are, and in whose space.
    clock : callable
        Time in s by which frames come and clients are silent; that of the whole bridge.

    Attributes
    ----------
    command : Command
        Who commands.
    count : int
        Frames that came.
    """

    rig: Rig
    clock: Callable[[], float] = time.perf_counter
    command: Command = field(default_factory=Command)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _commander: Commander | None = None
    _given: dict[str, dict[str, Any]] = field(default_factory=dict)
    _frames: tuple[Arrived | None, Arrived | None] = (None, None)
    _ways: deque[float] = field(default_factory=lambda: deque(maxlen=DELAY_FRAMES))  # and the clocks' difference
    _late: float = 0.0
    _effects: dict[str, Effect] = field(default_factory=dict)
    count: int = 0
    stop_requested: bool = False

    def __post_init__(self) -> None:
        import scipy.spatial.transform  # noqa: F401 - here: no cycle may wait for its import

    def put(self, frame: Frame, now: float, commander: Commander | None = None) -> None:
        """Take a frame. One that is refused changes nothing.

        The first of another client begins anew: its hand has not moved, and none of the effects stay.

        Parameters
        ----------
        now : float
            When it came, in s.
        commander : Commander, optional
            Who sent it; this process if left out.

        Raises
        ------
        FrameRefused
            The client does not command any more, the rig has no such bodies, or the frame's time goes back.
        EffectError
            An effect cannot be; names it and its parameter.
        """
        _require_in_command(commander)
        self._require_bodies(frame)
        effects = self._read(frame)
        with self._lock:
            _require_in_command(commander)  # it may have been dismissed meanwhile
            self._require_order(frame, now, commander)
            if commander is not self._commander:
                self._commander, self._frames, self._effects, self._given = commander, (None, None), {}, {}
                self._ways.clear()
            self._frames = (self._frames[1], Arrived(frame, now))
            self._ways.append(now - frame.time)
            self._late = self._ways[-1] - min(self._ways)
            self.count += 1
            if effects is not None:
                self._effects, self._given = effects, frame.effects or {}
            if commander is not None:
                commander.last_seen = now

    def _require_order(self, frame: Frame, now: float, commander: Commander | None) -> None:
        """Refuse a frame that was before the latest one of the same client."""
        latest = self._frames[1]
        if latest is None or commander is not self._commander or now - latest.time >= RESTART_S:
            return
        if frame.time < latest.frame.time:
            raise FrameRefused(
                f"time is {frame.time:.12g}, before {latest.frame.time:.12g} of the frame before; give s by one "
                f"clock that never goes back, or no frame for {RESTART_S:g} s where it begins anew"
            )

    def stop(self, now: float, commander: Commander) -> None:
        """End the run; `FrameRefused` if this client does not command."""
        _require_in_command(commander)
        commander.last_seen, self.stop_requested = now, True

    def dismiss(self, reason: str) -> None:
        """Remove the effects, and dismiss the client that commands, with a reason."""
        with self._lock:
            self._effects, self._given = {}, {}
            self.command.dismiss(reason)

    def _read(self, frame: Frame) -> dict[str, Effect] | None:
        """Return the effects of a frame. Clients repeat them: those that are as before are not read again."""
        if frame.effects is None:
            return None
        known, before = self._effects, self._given
        return {
            name: known[name]
            if name in known and before.get(name) == given
            else parse_effect(name, given, self.rig)
            for name, given in frame.effects.items()
        }

    def _require_bodies(self, frame: Frame) -> None:
        """Refuse bodies that the rig does not have, of another dimension, or at an anchor."""
        rig = self.rig
        for name, body in frame.bodies.items():
            if name != HAND and name not in rig.frames:
                there = ", ".join([HAND, *rig.frames])
                raise FrameRefused(f"bodies: this rig has no body {name!r}; there are: {there}")
            if (given := len(body.position)) != rig.dimension:
                raise FrameRefused(
                    f"bodies: position of {name!r} has {given} numbers; give {rig.dimension}, as the rig has axes"
                )
        if frame.bodies:
            self._require_cables(frame)

    def _require_cables(self, frame: Frame) -> None:
        """Refuse bodies at an anchor, where a cable has no direction."""
        rig, hand = self.rig, frame.bodies.get(HAND)
        frames = rig.at_rest
        for name in set(frames) & set(frame.bodies):
            frames[name] = pose.CoordinateFrame(
                np.array(frame.bodies[name].position), _rotation(frame.bodies[name])
            )
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

        Between two frames it moves evenly, one frame behind: from the older place, where it is taken to be when
        the newer frame comes, to the newer one. By the client's clock: a frame that came later than others did
        finds it further on, and where the next is late, it moves on for as long again. Were it to wait and to jump
        with each frame, its speed would be far off. After that it is at the newer place.
        """
        before, latest = self._frames
        if latest is None or name not in latest.frame.bodies:
            return None
        body, age = latest.frame.bodies[name], max(now - latest.time, 0.0)
        here = np.array(body.position)
        still = BodyMotion(here, np.zeros_like(here), _rotation(body))
        if before is None or name not in before.frame.bodies:
            return still
        there = np.array(before.frame.bodies[name].position)
        apart = max(latest.frame.time - before.frame.time, MIN_FRAME_GAP_S)
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


def _rotation(body: Body) -> Floats | None:
    """Return the rotation of a quaternion x, y, z, w: a matrix; in the plane, the angle about z in rad."""
    if body.rotation is None:
        return None
    if len(body.position) == 2:
        return np.array(2.0 * np.arctan2(*body.rotation[2:]))
    from scipy.spatial.transform import Rotation

    matrix: Floats = Rotation.from_quat(body.rotation).as_matrix()
    return matrix
