"""Somebody whose hand or head the cables hold: it means to go somewhere, and gives way to them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.demand import Pose
from tensionlab.errors import ScenarioError
from tensionlab.haptics.effects.parameters import (
    PositiveDamping,
    PositiveMass,
    PositiveStiffness,
    require_parameters,
)
from tensionlab.model.rig import Rig
from tensionlab.scenarios.script import Script

STEP = 1e-3
"""The longest step of the integration, in s."""
AHEAD = 1e-4
"""For how fast the place is that it means to be at, in s."""


@dataclass(frozen=True)
class PersonPlan:
    """What moves, and how does it mean to?

    A mass on a spring and a damper whose other end follows a script: the equilibrium point of an arm (Hogan 1985,
    "The mechanics of multi-joint posture and movement control").

    Parameters
    ----------
    mass : float
        Of the hand with what moves along, or of the head, in kg.
    stiffness, damping : float
        With which it is held to the script, in N/m and N s/m.
    script : Script
        Of the hand or the head.
    bodies : mapping of str to Script
        Of the frames that modules ride on: where their origin is. They do not turn.
    """

    mass: PositiveMass
    stiffness: PositiveStiffness
    damping: PositiveDamping
    script: Script
    bodies: Mapping[str, Script] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_parameters(self, ScenarioError)


@dataclass(frozen=True, eq=False)
class Felt:
    """What became of a person: rows, one a ms.

    Attributes
    ----------
    time : (K,) array
        In s since the script began.
    position : (K, d) array
        Of the hand or the head, in m.
    force : (K, d) array
        That the cables really pulled it with, in N.
    tensions : (K, m) array
        Of the cables, in N.
    """

    time: Floats
    position: Floats
    force: Floats
    tensions: Floats


class Person:
    """A simulated person: a motion that gives way to the cables.

    It stands still where its script starts until `begin` is called.

    Parameters
    ----------
    plan : PersonPlan
    rig : Rig
        Whose point is the hand or the head.

    Attributes
    ----------
    pose : Pose
        Where hand or head and bodies are now.
    """

    def __init__(self, plan: PersonPlan, rig: Rig) -> None:
        self._plan, self._rig = plan, rig
        self._time, self._start = 0.0, math.inf
        self._place = plan.script.position(0.0)
        self._velocity: Floats = np.zeros_like(self._place)
        self._tensions: Floats = np.zeros(rig.m)
        self._rows: list[tuple[float, Floats, Floats, Floats]] = []
        self.pose = self._posed()

    def begin(self) -> None:
        """Let the script begin now, unless it has."""
        self._start = min(self._start, self._time)

    def apply_tensions(self, tensions: Floats) -> None:
        """Take what the cables pull with from now on, (m,) in N."""
        self._tensions = tensions

    def __call__(self, time: float) -> Pose:
        """Where are hand or head and bodies, at a time in s that does not go back?"""
        while (left := time - self._time) > 1e-9:
            step = min(left, STEP)
            self._time += step
            if self._start < math.inf:
                self._move(step)
        return self.pose

    @property
    def felt(self) -> Felt:
        """What became of it since its script began?"""
        time, position, force, tensions = zip(*self._rows, strict=True) if self._rows else ((),) * 4
        d, m = self._rig.dimension, self._rig.m
        return Felt(
            np.array(time),
            np.array(position).reshape(-1, d),
            np.array(force).reshape(-1, d),
            np.array(tensions).reshape(-1, m),
        )

    def _move(self, step: float) -> None:
        """Take one step; velocities first, which keeps a spring from gaining energy."""
        plan, now = self._plan, self._time - self._start
        goal = plan.script.position(now)
        speed = (plan.script.position(now + AHEAD) - goal) / AHEAD
        force = self._rig.structure_matrix(*self.pose) @ self._tensions
        own = plan.stiffness * (goal - self._place) + plan.damping * (speed - self._velocity)
        self._velocity = self._velocity + step * (own + force) / plan.mass
        self._place = self._place + step * self._velocity
        self.pose = self._posed()
        self._rows.append((now, self._place, force, self._tensions))

    def _posed(self) -> Pose:
        now = max(self._time - self._start, 0.0)
        frames = {name: (script.position(now), None) for name, script in self._plan.bodies.items()}
        return Pose(self._place, frames=frames)
