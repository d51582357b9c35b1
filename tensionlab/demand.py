"""State of a rig and demands on it: where `tensionlab.haptics` and `tensionlab.hardware` meet.

The runner calls a demand source once a cycle and knows nothing of effects; effects and scenarios are such sources
and know nothing of modules.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.model.pose import Frames
from tensionlab.support.arrays import Floats, Integers


class Pose(NamedTuple):
    """Pose of the point or the platform; fields as the arguments of `Rig.structure_matrix`.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.hardware import Pose
    >>> Pose(np.array([0.0, 0.3, 0.0])).rotation is None
    True
    """

    position: Floats
    rotation: Floats | None = None
    frames: Frames | None = None


@dataclass(frozen=True, eq=False)
class RigState:
    """State of the rig in a cycle, as far as the host knows it.

    Arrays over cables have the rig's order; NaN where a module has not yet reported.

    Attributes
    ----------
    cycle, time : int, float
        Number of the cycle, from 0; s since the run began.
    twist : (n,) array
        Velocity that fits the cables' speeds best: m/s, and rad/s where the platform turns.
    structure : (n, m) array
        Structure matrix at that pose.
    lengths, speeds, tensions : (m,) arrays
        Of the cables at the time of the pose, in m; of paying out, in m/s; as measured by the modules, in N, NaN
        where the report is old.
    ages : (m,) array
        Time since the latest telemetry came, in s; infinite before the first.
    active : (m,) array of bool
        Modules that take part. One that is lost does not come back within a run.
    states, faults, limiters, brakes : (m,) arrays of int
        `codes.State`, `codes.Fault`, `codes.Limit`, which holds its tension back, and `codes.BrakeState` as
        measured of each module; brakes are -1 before the first telemetry.
    last_sequence : (m,) array of int
        Sequence number of the set-point that each module followed last; -1 before the first telemetry.
    delays : (m,) array
        How long ago that set-point was sent, in s: the latency of the loop. NaN before the first.
    windings : (m,) array
        Estimated temperature of each winding, in °C.
    upper_now : (m,) array
        Upper tension limits now, in N: the rig's, or less where a winding is warm or a body is near.
    clearance : (m,) array
        Distance of each cable from the nearest body of the rig, less the body's sway, in m; NaN without bodies.
    """

    cycle: int
    time: float
    pose: Pose
    twist: Floats
    structure: Floats
    lengths: Floats
    speeds: Floats
    tensions: Floats
    ages: Floats
    active: NDArray[np.bool_]
    states: Integers
    faults: Integers
    limiters: Integers
    brakes: Integers
    last_sequence: Integers
    delays: Floats
    windings: Floats
    upper_now: Floats
    clearance: Floats


class Impedance(NamedTuple):
    """Impedance that a module renders at its own rate, instead of a tension: `protocol.SetImpedance`. SI units.

    The phase is that of the vibration when the run begins, in turns, equally for all modules.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.hardware import Demand, Impedance
    >>> Demand(np.zeros(3), impedances={"top": Impedance(rest=2.0, stiffness=100.0)}).impedances["top"].damping
    0.0
    """

    rest: float
    stiffness: float = 0.0
    damping: float = 0.0
    feed_forward: float = 0.0
    amplitude: float = 0.0
    frequency: float = 0.0
    phase: float = 0.0

    def tension(self, length: float, speed: float) -> float:
        """Return the tension in N, vibration aside, at a length in m and a speed of paying out in m/s."""
        spring = self.stiffness * max(length - self.rest, 0.0)
        return self.feed_forward + spring + self.damping * max(speed, 0.0)


@dataclass(frozen=True, eq=False)
class EffectDemand:
    """What an effect desires in a cycle, and what of it is not rendered."""

    force: Floats  # on the hand, without a vibration, (d,) in N
    stiffness: float = 0.0  # in N/m; 0 of an effect without
    damping: float = 0.0  # in N s/m
    frequency: float = 0.0  # of ripples that pass or of a vibration, in Hz
    amplitude: float = 0.0  # of the vibration, in N
    gain: float = 1.0  # amplitude of the vibration on the hand per amplitude of the reported tensions
    # Parameters that are not rendered as desired: their desired and their rendered values.
    softened: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def share(self) -> float:
        """Smallest share of a parameter that is rendered; 1 if nothing is softened."""
        return min((rendered / desired for desired, rendered in self.softened.values() if desired), default=1.0)


class EffectTable(NamedTuple):
    """Effect over K cycles, as in `EffectDemand`; NaN while it was not active."""

    force: Floats  # (K, d), the others (K,)
    stiffness: Floats
    damping: Floats
    frequency: Floats
    amplitude: Floats
    gain: Floats
    share: Floats


def tabulate_effects(cycles: Sequence[Mapping[str, EffectDemand]], dimension: int) -> dict[str, EffectTable]:
    """Return the effects of cycles by name, no more than the first `MAX_EFFECTS`."""
    tables: dict[str, EffectTable] = {}
    for index, effects in enumerate(cycles):
        for name, effect in effects.items():
            if name not in tables and len(tables) < MAX_EFFECTS:
                numbers = [np.full(len(cycles), np.nan) for _ in EffectTable._fields[1:]]
                tables[name] = EffectTable(np.full((len(cycles), dimension), np.nan), *numbers)
            for column, values in zip(EffectTable._fields, tables.get(name, ()), strict=False):
                values[index] = getattr(effect, column)
    return tables


MAX_EFFECTS = 256  # effects of a run of which its tables tell
UNITS = {"stiffness": "N/m", "damping": "N s/m", "frequency": "Hz", "amplitude": "N", "height": "m"}
SOFTER = 0.25  # relative change of a rendered value that is reported again
SOFTENED_S = 1.0  # a softening that was absent for this time has ended


class Softening(NamedTuple):
    """Change of the rendered value of an effect's parameter; softening has ended if it is the desired one."""

    effect: str
    parameter: str
    desired: float
    rendered: float
    since: float  # when it was first rendered softer, in s

    @property
    def text(self) -> str:
        """Message about the change."""
        unit = UNITS.get(self.parameter.rpartition(".")[2].split(" ")[0], "")
        if self.rendered == self.desired:
            return f'"{self.effect}": {self.parameter} is {self.desired:g} {unit} again, as desired'
        if self.parameter == "frequency":
            why = "no free cable lies along it, and the host's set-points are too slow; give another --rate"
            return f'"{self.effect}": its vibration of {self.desired:g} Hz is left out: {why}'
        return f'"{self.effect}": {self.parameter} is {self.desired:g} {unit}, {self.rendered:.3g} are rendered'


class SoftenedEffects:
    """Softened parameters of effects, followed from cycle to cycle."""

    def __init__(self) -> None:
        # Of each effect and parameter; with the times of its latest report and of its latest cycle.
        self._known: dict[tuple[str, str], tuple[Softening, float, float]] = {}

    def update(self, time: float, effects: Mapping[str, EffectDemand]) -> list[Softening]:
        """Return what has changed at a time in s: softenings that begin, differ by a quarter, or have ended.

        One that changes all the time is reported once a second.
        """
        changes = []
        for name, effect in effects.items():
            for parameter, (desired, rendered) in effect.softened.items():
                known, reported, _ = self._known.get((name, parameter), (None, 0.0, 0.0))
                if known is None:
                    known, reported = Softening(name, parameter, desired, rendered, time), time
                    changes.append(known)
                elif time - reported >= SOFTENED_S and abs(rendered - known.rendered) > SOFTER * known.rendered:
                    known, reported = known._replace(rendered=rendered), time
                    changes.append(known)
                self._known[name, parameter] = known, reported, time
        for key, (known, _, latest) in list(self._known.items()):
            if time - latest >= SOFTENED_S:
                del self._known[key]
                changes.append(known._replace(rendered=known.desired))
        return changes


@dataclass(frozen=True, eq=False)
class Demand:
    """What the rig is to render until the next cycle.

    Attributes
    ----------
    wrench : (n,) array or None
        Wrench of all modules together, in N and N·m, on top of `Rig.required`. None: nothing on top,
        and without that each cable is held at its lower limit.
    impedances : mapping of str to Impedance
        Modules, by name, with a module-local impedance. The others render the rest of the wrench.
    brakes : set of str
        Modules whose brake is commanded on. What it holds comes on top of the wrench.
    stop : bool
        End the run: all modules release.
    desired : (n,) array or None
        Wrench that the application desires, where ``wrench`` is only what can be rendered of it, such as of a wall
        that is too stiff for the loop. None: ``wrench`` itself.
    effects : mapping of str to EffectDemand
        Parts of it, by the effects' names.

    Examples
    --------
    >>> import numpy as np
    >>> from tensionlab.hardware import Demand
    >>> Demand(np.array([0.0, 0.0, 1.5])).brakes
    frozenset()
    """

    wrench: Floats | None = None
    impedances: Mapping[str, Impedance] = field(default_factory=dict)
    brakes: frozenset[str] = frozenset()
    stop: bool = False
    desired: Floats | None = None
    effects: Mapping[str, EffectDemand] = field(default_factory=dict)


def measured_wrench(structure: Floats, tensions: Floats, active: NDArray[np.bool_]) -> Floats:
    """Return the wrench (..., n) in N and N·m that reported tensions (..., m) in N exert.

    It is NaN where the tension of a module that takes part is unknown. A lost module counts while it reports; one
    that is silent has timed out and releases its cable.
    """
    known = np.where(active | np.isfinite(tensions), tensions, 0.0)
    return np.asarray(np.einsum("...nm,...m->...n", structure, known))


DemandSource = Callable[[RigState], Demand]  # function that returns the demand for a state; called once a cycle
