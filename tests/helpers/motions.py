"""Motions of a hand for the tests of effects: where it is, held, moved steadily, or wound in closed loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st

from tensionlab.haptics.effects import Effect, Memory, Motion, Rendered
from tensionlab.haptics.rendering.renderer import StageMemory, Stages


def at(*position, velocity=(0.0, 0.0, 0.0), **more):
    """One hand, somewhere, at rest unless it says otherwise."""
    return Motion(np.array(position, dtype=float), np.array(velocity, dtype=float), **more)


def follow(effect, positions, step, velocities=None):
    """Forces along a path (steps, ..., d) that is passed in so many s a step."""
    positions = np.asarray(positions, dtype=float)
    if velocities is None:
        velocities = np.gradient(positions, step, axis=0)
    memory, forces = None, np.empty_like(positions)
    for k, (position, velocity) in enumerate(zip(positions, velocities, strict=True)):
        forces[k], memory, _ = effect.render(Motion(position, velocity, k * step, step), memory)
    return forces


class StagedMemory(NamedTuple):
    """Memory of an effect and of the stages that its force passes."""

    effect: Memory
    stages: StageMemory


class Staged(NamedTuple):
    """Effect whose force passes the stages, as in the renderer."""

    effect: Effect
    stages: Stages = Stages()

    def render(self, motion, memory=None):
        """Return the force after the stages."""
        inner, before = memory or (None, None)
        smooth = self.stages.smooth(motion, before)
        done = self.effect.render(smooth, inner)
        force, stages = self.stages.filter(done.force, smooth, done.bypass_slew, before)
        return Rendered(force, StagedMemory(done.memory, stages), done.bypass_slew)


def given(forces, positions):
    """Energy that forces along a path gave to the hand, up to each step, in J; by the trapezoid rule."""
    moved = np.diff(positions, axis=0)
    work = np.einsum("k...i,k...i->k...", (forces[1:] + forces[:-1]) / 2, moved)
    return np.concatenate([np.zeros_like(work[:1]), np.cumsum(work, axis=0)])


@st.composite
def closed_paths(draw, steps, size=0.04, hands=8):
    """Positions (steps, hands, 3) that end where they begin: three harmonics an axis, up to 4 cm each."""
    count = 3 * hands * 3
    amplitudes = draw(st.lists(st.floats(-size, size), min_size=count, max_size=count))
    phases = draw(st.lists(st.floats(0.0, 2 * np.pi), min_size=count, max_size=count))
    a, b = (np.reshape(numbers, (3, hands, 3)) for numbers in (amplitudes, phases))
    s = np.linspace(0.0, 2 * np.pi, steps)[:, None, None, None]
    return (a * np.sin(np.arange(1, 4)[:, None, None] * s + b)).sum(axis=1)
