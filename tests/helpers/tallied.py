"""Metric that keeps a tally of what was evaluated where, so that a test can count it.

It is a module of its own because other processes import it: a sweep that is killed, and the workers of a cluster.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from tensionlab.workspace.metrics import Batch, Metric


def tallied(file: Path | str, seconds: float = 0.0, gate: Path | str = "", held_after: int = 0) -> Metric:
    """Return the metric; all processes wait for the file ``gate`` after so many chunks, if it is named.

    A process that waits makes a file with its number.
    """
    parameters = {"file": str(file), "seconds": seconds, "gate": str(gate), "held_after": held_after}
    return Metric("tallied", _distance, "m", title="distance", parameters=parameters)


def _distance(batch: Batch, file: str, seconds: float, gate: str, held_after: int) -> np.ndarray:
    """Distance of the pose from the origin."""
    if len(batch.position):
        time.sleep(seconds)
        with Path(file).open("a") as tally:
            tally.write(f"{os.getpid()} {' '.join(map(str, batch.position[0]))}\n")
        if gate and len(read(Path(file))) > held_after:
            Path(f"{gate}.{os.getpid()}").touch()
            while not Path(gate).exists():
                time.sleep(0.005)
    return np.asarray(np.linalg.norm(batch.position, axis=1))


def read(file: Path) -> list[tuple[int, tuple[float, ...]]]:
    """Return which process evaluated which chunk, known by its first pose."""
    rows = [line.split() for line in file.read_text().splitlines()] if file.exists() else []
    return [(int(process), tuple(map(float, pose))) for process, *pose in rows]
