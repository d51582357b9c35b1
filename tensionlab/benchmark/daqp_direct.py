"""DAQP by its own Python module: the fastest peer, without qpsolvers in between."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tensionlab.arrays import Floats
from tensionlab.errors import MissingDependency
from tensionlab.solvers.peer import Reply, own_tensions
from tensionlab.solvers.quadratic import TIGHT

EQUALITY = 5
"""How DAQP marks a constraint that is an equality."""


def load() -> Any:
    """DAQP's module.

    Raises
    ------
    MissingDependency
        If it is not installed.
    """
    try:
        import daqp
    except ImportError as error:
        raise MissingDependency("DAQP is not installed; pip install 'tensionlab[solvers]'") from error
    return daqp


def installed() -> bool:
    """Whether DAQP's module is there."""
    return importlib.util.find_spec("daqp") is not None


def sense(components: int, cables: int) -> NDArray[np.int32]:
    """What DAQP should take each constraint for: first the limits of the cables, then the equations."""
    return np.array([0] * cables + [EQUALITY] * components, dtype=np.int32)


@dataclass(frozen=True)
class DirectDaqp:
    """Which tensions does DAQP give for least ``|t|²``, ``W t = w`` and the limits, called directly?

    Source: Arnström, Bemporad and Axehill, "A dual active-set solver for embedded quadratic programming using
    recursive LDL' updates", 2022.

    Parameters
    ----------
    settings : {"default", "tight"}
        Its own defaults, or those of `tensionlab.solvers.quadratic.TIGHT`.
    """

    settings: Literal["default", "tight"] = "default"

    def __post_init__(self) -> None:
        load()

    def build(self, structure: Floats, wrench: Floats, lower: Floats, upper: Floats) -> Any:
        """Stack limits and equations as DAQP takes them."""
        n, m = structure.shape
        above, below = np.concatenate([upper, wrench]), np.concatenate([lower, wrench])
        return np.eye(m), np.zeros(m), structure, above, below, sense(n, m)

    def run(self, program: Any) -> Reply:
        """Solve it."""
        options = TIGHT["daqp"] if self.settings == "tight" else {}
        found, _, flag, info = load().solve(*program, **options)
        tensions = own_tensions(found, len(program[1]))
        return Reply(
            tensions,
            iterations=int(info["iterations"]),
            setup_s=float(info["setup_time"]),
            solve_s=float(info["solve_time"]),
            failure="" if tensions is not None else f"gave no finite tensions (exit flag {flag})",
        )
