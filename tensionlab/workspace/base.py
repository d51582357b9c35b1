"""What a measure is given, and what it must answer.

A measure is a frozen dataclass of its hyper-parameters, all with defaults, and one method. The first line of
its docstring is the question that it answers, which the command line prints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from tensionlab.arrays import Floats
from tensionlab.model.pose import Frames
from tensionlab.model.rig import Rig


@dataclass(frozen=True, eq=False)
class Batch:
    """B poses of one rig at which no cable has length zero, and what its cables can exert there.

    Attributes
    ----------
    rig : Rig
    position : (B, d) array
        In m.
    rotation : (B, 3, 3) array, (B,) array or None
        As in `Rig.structure_matrix`.
    frames : mapping
        Where the body frames of the rig are.
    structure : (B, n, m) array
        Structure matrices W.
    """

    rig: Rig
    position: Floats
    rotation: Floats | None
    frames: Frames
    structure: Floats


class Measure(Protocol):
    """One question to a batch of poses.

    Attributes
    ----------
    title, unit : str
        What a value is called, and its unit.
    above_zero : str
        What is so where a value is above zero; empty where that says nothing.
    """

    title: ClassVar[str]
    unit: ClassVar[str]
    above_zero: ClassVar[str]

    def evaluate(self, batch: Batch) -> Floats:
        """Find the value at every pose, (B,)."""
        ...
