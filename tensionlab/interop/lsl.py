"""Streams of a run for Lab Streaming Layer, extra ``lsl``: forces, tensions, pose, and what happens.

Whatever else a study records comes with the same clock, and a recorder brings it all together (Kothe et al. 2025,
"The lab streaming layer for synchronized multimodal recording").
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.demand import measured_wrench
from tensionlab.errors import MissingDependency, optional_import
from tensionlab.hardware.protocol.messages import Info
from tensionlab.hardware.runner.cycle_table import demanded_wrench, desired_wrench, rotation_matrix
from tensionlab.hardware.runner.records import Cycle, RunEvent, Statistics
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

if TYPE_CHECKING:
    from pylsl import StreamOutlet

__all__ = ["LslStreams", "require_lsl"]

LAST_SAMPLES_S = 0.3  # time for inlets to get the last samples before their outlet is closed


class StreamChannel(NamedTuple):
    """Label, unit and type of a channel of a stream."""

    label: str
    unit: str
    type: str


class LslStreams:
    """Streams of a run for Lab Streaming Layer, a sink of a `Runner`.

    There are four streams, each named after the rig and its content, as in "floor-3 forces":

    - *forces* (type Force): ``desired``, ``commanded`` and ``measured``, each with the components of a wrench, in
      N and N·m. Desired is NaN where the run only holds the cables taut, measured where a tension is unknown.
    - *tensions* (type Tension): ``commanded`` and ``measured`` of each module, in N; NaN where its report is old.
    - *pose* (type MoCap): position in m and, of a platform, the orientation: a quaternion, or an angle in rad.
    - *markers* (type Markers): texts, such as "armed: 4 modules", "phase: touch" or "ended: duration reached".

    There is a sample of the first three for each cycle. All are stamped with ``pylsl.local_clock``, a cycle's with
    the time at which it began; they come at irregular times, as LSL calls it, so that no recorder moves them. An
    error of LSL does not affect the run: the streams end, and ``error`` says why.

    Parameters
    ----------
    rig : Rig
    solver : str
        Its name, for the description of the streams.
    rate : float
        Cycles per second, for the description.

    Attributes
    ----------
    error : str or None
        Why the streams ended before the run did.

    Raises
    ------
    MissingDependency
        If pylsl, or the library that it loads, is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> from tensionlab.hardware import Demand, Runner, World, WorldClock
    >>> from tensionlab.interop.lsl import LslStreams
    >>> rig = tl.load_rig("floor-3")
    >>> world, streams = World(rig), LslStreams(rig, "newton", 50.0)
    >>> clock = WorldClock(world)
    >>> runner = Runner(rig, world.group(), "newton", lambda state: Demand(), sinks=[streams], clock=clock)
    >>> _ = runner.run(seconds=0.1)
    >>> print(streams.error)
    None
    """

    def __init__(self, rig: Rig, solver: str, rate: float) -> None:
        from scipy.spatial.transform import Rotation  # here: no cycle may wait for its import

        lsl = require_lsl()
        self._rig, self._turn = rig, Rotation.from_matrix
        self._clock: Callable[[], float] = lsl.local_clock
        self._sending = threading.Lock()  # events come from any thread
        self.error: str | None = None
        source = f"tensionlab {rig.name} {os.getpid()}"
        described = {"rig": rig.name, "solver": solver, "rate_hz": f"{rate:g}"}

        def outlet(what: str, kind: str, channels: list[StreamChannel], numbers: bool = True) -> StreamOutlet:
            """Return the outlet of a stream of irregular rate, its channels described in its header."""
            value_type = lsl.cf_double64 if numbers else lsl.cf_string
            name, rate = f"{rig.name} {what}", lsl.IRREGULAR_RATE
            info = lsl.StreamInfo(name, kind, len(channels), rate, value_type, f"{source} {what}")
            for key, value in described.items():
                info.desc().append_child_value(key, value)
            listed = info.desc().append_child("channels")
            for channel in channels:
                one = listed.append_child("channel")
                for key, value in channel._asdict().items():
                    one.append_child_value(key, value)
            return lsl.StreamOutlet(info)

        axes = "xyz"[: rig.dimension]
        torques = axes if rig.n == 6 else "z" if rig.n > rig.dimension else ""
        wrench = [(f"F{axis}", "N") for axis in axes] + [(f"M{axis}", "N·m") for axis in torques]
        position = [StreamChannel(f"Position{axis.upper()}", "m", f"Position{axis.upper()}") for axis in axes]
        orientation = [StreamChannel(f"Orientation{axis}", "quaternion", f"Orientation{axis}") for axis in "XYZW"]
        if rig.n == 3 and rig.dimension == 2:
            orientation = [StreamChannel("OrientationZ", "rad", "OrientationZ")]
        kinds = ("desired", "commanded", "measured")
        forces = [StreamChannel(f"{kind} {name}", unit, kind) for kind in kinds for name, unit in wrench]
        names = [module.name for module in rig.modules]
        tensions = [StreamChannel(f"{kind} {name}", "N", kind) for kind in kinds[1:] for name in names]
        self._forces = outlet("forces", "Force", forces)
        self._tensions = outlet("tensions", "Tension", tensions)
        self._pose = outlet("pose", "MoCap", position + (orientation if rig.n > rig.dimension else []))
        self._markers = outlet("markers", "Markers", [StreamChannel("event", "", "Marker")], numbers=False)

    def write(self, cycle: Cycle) -> None:
        """Send the samples of a cycle."""
        began = self._clock() - cycle.compute_time
        state = cycle.state
        forces = [desired_wrench(cycle, self._rig), demanded_wrench(cycle, self._rig)]
        forces.append(measured_wrench(state.structure, state.tensions, state.active))
        self._send(self._forces, np.concatenate(forces).tolist(), began)
        self._send(self._tensions, [*cycle.commanded.tolist(), *state.tensions.tolist()], began)
        self._send(self._pose, [*state.pose.position, *self._orientation(cycle)], began)

    def note(self, event: RunEvent) -> None:
        """Send a marker."""
        self._send(self._markers, [f"{event.kind} {event.module}".strip() + f": {event.text}"], self._clock())

    def begin(self, infos: Mapping[str, Info], statistics: Statistics) -> None:
        """Send the marker with which a run begins."""
        self._send(self._markers, [f"begins: {self._rig.name}"], self._clock())

    def close(self, statistics: Statistics) -> None:
        """End the streams, when inlets have had time for the last samples."""
        outlets = (self._forces, self._tensions, self._pose, self._markers)
        if self.error is None and any(outlet.have_consumers() for outlet in outlets):
            time.sleep(LAST_SAMPLES_S)
        with self._sending:
            del self._forces, self._tensions, self._pose, self._markers  # pylsl ends a stream with its outlet

    def _orientation(self, cycle: Cycle) -> Floats:
        """Return the quaternion x, y, z, w of what turns, or its angle in the plane; nothing for a point."""
        rig = self._rig
        if rig.n == rig.dimension:
            return np.zeros(0)
        rotation = rotation_matrix(cycle, rig)
        if rig.dimension == 2:
            return np.array([np.arctan2(rotation[1, 0], rotation[0, 0])])
        return np.asarray(self._turn(rotation).as_quat())

    def _send(self, outlet: Any, sample: list[Any], when: float) -> None:
        if self.error is not None:
            return
        try:
            with self._sending:
                outlet.push_sample(sample, when)
        except Exception as error:  # no error of a stream may end the run
            self.error = f"{type(error).__name__}: {error}"


def require_lsl() -> ModuleType:
    """Return pylsl; MissingDependency if it, or the library that it loads, is not installed."""
    with optional_import("lsl", "streams for Lab Streaming Layer"):
        try:
            import pylsl
        except (OSError, RuntimeError) as error:
            why = str(error).split("\n", 1)[0]
            raise MissingDependency(
                f"streams for Lab Streaming Layer need liblsl, which pylsl does not find ({why:.100}); see "
                "the installation of pylsl"
            ) from None
    module: ModuleType = pylsl
    return module
