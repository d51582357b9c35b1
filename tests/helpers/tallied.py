"""Metric that keeps a tally of what was evaluated where, so that a test can count it.

It is a module of its own because other processes import it: a sweep that is killed, and the workers of a cluster.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from tensionlab.workspace.metrics import Batch


@dataclass(frozen=True)
class Tallied:
    """Distance of the pose from the origin."""

    file: str = ""
    seconds: float = 0.0
    gate: str = ""
    """File that all wait for after so many chunks (`held_after`); who waits makes one with its number."""
    held_after: int = 0

    title: ClassVar[str] = "distance"
    unit: ClassVar[str] = "m"
    above_zero: ClassVar[str] = ""

    def evaluate(self, batch: Batch) -> np.ndarray:
        """Return the value at every pose, and write down the process and the first pose."""
        if len(batch.position):
            time.sleep(self.seconds)
            line = f"{os.getpid()} {' '.join(map(str, batch.position[0]))}\n"
            with Path(self.file).open("a") as tally:
                tally.write(line)
            if self.gate and len(read(Path(self.file))) > self.held_after:
                Path(f"{self.gate}.{os.getpid()}").touch()
                while not Path(self.gate).exists():
                    time.sleep(0.005)
        return np.linalg.norm(batch.position, axis=1)


def read(file: Path) -> list[tuple[int, tuple[float, ...]]]:
    """Return which process evaluated which chunk, known by its first pose."""
    rows = [line.split() for line in file.read_text().splitlines()] if file.exists() else []
    return [(int(process), tuple(map(float, pose))) for process, *pose in rows]
