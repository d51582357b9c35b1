"""State of a rig and demands on it: where `tensionlab.haptics` and `tensionlab.hardware` meet.

The runner calls a demand source once a cycle and knows nothing of effects; effects and scenarios are such sources
and know nothing of modules.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
        Of the cables, in m; of paying out, in m/s; as measured by the modules, in N, NaN where the report is old.
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
    thermal : (m,) array
        Share of each winding's budget that is spent.
    upper_now : (m,) array
        Upper tension limits now, in N: the rig's, or less where a winding is warm or a body is near.
    clearance : (m,) array
        Distance of each cable from the nearest body of the rig, less the body's sway, in m; NaN without bodies.

    Examples
    --------
    >>> import numpy as np
    >>> import tensionlab as tl
    >>> from tensionlab.hardware import Demand, Runner, World, WorldClock
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> world, pull = World(rig), Demand(np.array([0.0, 0.0, 1.5]))
    >>> runner = Runner(rig, world.group(), "newton", lambda state: pull, clock=WorldClock(world))
    >>> _ = runner.run(seconds=1.0)
    >>> state = runner.latest.state
    >>> state.structure.shape, bool(state.active.all())
    ((3, 4), True)
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
    thermal: Floats
    upper_now: Floats
    clearance: Floats


@dataclass(frozen=True)
class Impedance:
    """Impedance that a module renders at its own rate, instead of a tension: `protocol.SetImpedance`. SI units.

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

    def tension(self, length: float, speed: float) -> float:
        """Return the tension in N, vibration aside, at a length in m and a speed of paying out in m/s."""
        spring = self.stiffness * max(length - self.rest, 0.0)
        return self.feed_forward + spring + self.damping * max(speed, 0.0)


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


def measured_wrench(structure: Floats, tensions: Floats, active: NDArray[np.bool_]) -> Floats:
    """Return the wrench (..., n) in N and N·m that reported tensions (..., m) in N exert.

    It is NaN where the tension of a module that takes part is unknown. A lost module counts while it reports; one
    that is silent has timed out and releases its cable.
    """
    known = np.where(active | np.isfinite(tensions), tensions, 0.0)
    return np.asarray(np.einsum("...nm,...m->...n", structure, known))


DemandSource = Callable[[RigState], Demand]  # function that returns the demand for a state; called once a cycle
