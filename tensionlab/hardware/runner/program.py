"""Checks of demands, and programs: wrenches one after another, from a file as `tensionlab new program` writes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike
from typing import Any, Literal

import numpy as np
from pydantic import Field, FiniteFloat

from tensionlab.demand import Demand, RigState
from tensionlab.errors import HardwareError
from tensionlab.model.rig import Rig
from tensionlab.model.schema import SchemaTable
from tensionlab.support.arrays import Floats
from tensionlab.support.files.reading import brief, read_toml
from tensionlab.support.validation import raises, validate

Amplitude = Field(description="the amplitude of each component of the wrench, a list of N and N·m")
Frequency = Field(gt=0.0, allow_inf_nan=False, description="a frequency in Hz, a number")


class Sine(SchemaTable):
    """Sine along its amplitude."""

    amplitude: list[FiniteFloat] = Amplitude
    frequency: float = Frequency


class Circle(SchemaTable):
    """Force that turns in a plane, from the first of its axes to the second."""

    radius: float = Field(gt=0.0, allow_inf_nan=False, description="the size of the force in N, a number")
    plane: Literal["xy", "yx", "yz", "zy", "zx", "xz"] = Field(description='two axes, such as "xz"')
    frequency: float = Frequency


class Sweep(SchemaTable):
    """Sine along its amplitude, whose frequency changes exponentially from the begin to the end of a step."""

    amplitude: list[FiniteFloat] = Amplitude
    begin: float = Frequency
    end: float = Frequency


class ProgramStep(SchemaTable):
    """One ``[[steps]]`` entry."""

    seconds: float = Field(gt=0.0, allow_inf_nan=False, description="the duration in s, a number")
    wrench: list[float] = Field(description="what to render, a list of N, and of N·m after the forces")
    ramp: bool = Field(False, description="true or false: whether to go there evenly")
    brakes: list[str] = Field([], description="names of modules whose brake is on, a list")
    sine: Sine | None = Field(None, description="a sine around the wrench, a table")
    circle: Circle | None = Field(None, description="a circle around the wrench, a table")
    sweep: Sweep | None = Field(None, description="a sine of changing frequency around the wrench, a table")

    def wrench_at(self, time: float) -> Floats:
        """Return the wrench with all that is around it, at a time in s since the step began."""
        wrench, turn = np.array(self.wrench, dtype=np.float64), 2.0 * math.pi * time
        if self.sine is not None:
            wrench += math.sin(turn * self.sine.frequency) * np.array(self.sine.amplitude)
        if self.circle is not None:
            angle, axes = turn * self.circle.frequency, ["xyz".index(axis) for axis in self.circle.plane]
            wrench[axes] += self.circle.radius * np.array([math.cos(angle), math.sin(angle)])
        if self.sweep is not None:
            grown = math.log(self.sweep.end / self.sweep.begin) * time / self.seconds
            angle = turn * self.sweep.begin * (math.expm1(grown) / grown if grown else 1.0)
            wrench += math.sin(angle) * np.array(self.sweep.amplitude)
        return wrench


@raises(HardwareError)
class Program(SchemaTable):
    """Demand source that plays steps, and stops the run at its end unless it repeats.

    Examples
    --------
    >>> from tensionlab.hardware import Program
    >>> up, rest = {"seconds": 1.0, "wrench": [0.0, 1.0, 0.0]}, {"seconds": 2.0, "wrench": [0.0, 0.0, 0.0]}
    >>> Program(name="up", steps=[up, rest]).seconds
    3.0
    """

    name: str = Field(min_length=1, description="a name in quotes")
    repeat: bool = Field(False, description="true or false: whether to begin again at the end")
    steps: list[ProgramStep] = Field(min_length=1, description="at least one [[steps]] table")

    @property
    def seconds(self) -> float:
        """Duration of one round."""
        return sum(step.seconds for step in self.steps)

    def __call__(self, state: RigState) -> Demand:
        """Return the demand at the time of a state."""
        remaining = state.time % self.seconds if self.repeat else state.time
        later_round = self.repeat and state.time >= self.seconds
        previous_wrench = np.array(self.steps[-1].wrench) if later_round else np.zeros(len(self.steps[0].wrench))
        for step in self.steps:
            if remaining < step.seconds:
                wrench, share = step.wrench_at(remaining), remaining / step.seconds if step.ramp else 1.0
                return Demand(previous_wrench + share * (wrench - previous_wrench), brakes=frozenset(step.brakes))
            remaining -= step.seconds
            previous_wrench = np.array(step.wrench)
        return Demand(stop=True)


def load_program(path: str | PathLike[str], rig: Rig, rate: float = math.inf) -> Program:
    r"""Return the program in the TOML file at a path.

    HardwareError if it does not suit the rig, or a frequency is not below half the ``rate`` of the run, in Hz.

    Examples
    --------
    >>> from pathlib import Path
    >>> import tensionlab as tl
    >>> from tensionlab.hardware import load_program
    >>> _ = Path("push.toml").write_text('steps = [{seconds = 1.0, wrench = [0.0, 1.0, 0.0]}]\nname = "push"')
    >>> load_program("push.toml", tl.load_rig("bartels2026-validation")).name
    'push'
    """
    program = validate(Program, read_toml(path, "a program (*.toml)", HardwareError), HardwareError, path)
    for number, step in enumerate(program.steps, start=1):
        demand = Demand(np.array(step.wrench), brakes=frozenset(step.brakes))
        require_demand(demand, rig, f"{path}: step {number}")
        for oscillation in filter(None, (step.sine, step.circle, step.sweep)):
            _require_oscillation(oscillation.model_dump(), rig, rate, f"{path}: step {number}")
    return program


def _require_oscillation(keys: Mapping[str, Any], rig: Rig, rate: float, here: str) -> None:
    """Refuse what the rig has no axes for, or the cycles of a run would alias."""
    axes, amplitude = "xyz"[: rig.dimension], keys.get("amplitude")
    if not set(keys.get("plane", "")) <= set(axes):
        raise HardwareError(f'{here}: plane is "{keys["plane"]}"; this rig has the axes {", ".join(axes)}')
    if amplitude is not None and len(amplitude) != rig.n:
        raise HardwareError(f"{here}: amplitude is {brief(amplitude)}; this rig takes {rig.n} components")
    highest = max(keys.get(key, 0.0) for key in ("frequency", "begin", "end"))
    if highest >= rate / 2.0:
        raise HardwareError(f"{here}: {highest:g} Hz is not below half the rate of the run, {rate:g} Hz")


def require_demand(demand: object, rig: Rig, here: str) -> Demand:
    """Return what a demand source returned, or refuse what this rig cannot render; `here` names it in messages."""
    if not isinstance(demand, Demand):
        raise HardwareError(f"{here} is {demand!r}; return a Demand")
    for key, given in (("wrench", demand.wrench), ("desired", demand.desired)):
        if given is not None:
            wrench = np.asarray(given)
            fits = wrench.shape == (rig.n,)
            if not fits or not all(map(math.isfinite, wrench.tolist())):
                wanted = "all of it must be finite" if fits else f"this rig takes {rig.n} components"
                raise HardwareError(f"{here}: {key} is {brief(wrench.tolist())}; {wanted}")
    if demand.impedances or demand.brakes:
        modules = {module.name: module for module in rig.modules}
        for name in (*demand.impedances, *demand.brakes):
            if name not in modules:
                raise HardwareError(f'{here}: no module "{name}"; there are {", ".join(modules)}')
            if name in demand.brakes and modules[name].brake is None:
                raise HardwareError(f'{here}: module "{name}" has no brake')
        for name, spring in demand.impedances.items():
            if not all(map(math.isfinite, spring)):
                raise HardwareError(f'{here}: module "{name}": {spring}; all of it must be finite')
    return demand
