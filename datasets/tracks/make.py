"""Write the problems of every track again: ``python datasets/tracks/make.py``. A published track never changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from tensionlab.benchmark.problem_sets import Group, problem_of, problem_set
from tensionlab.benchmark.rigs import unit_vectors
from tensionlab.model.directions import grid18
from tensionlab.model.files import load_rig

FOLDER = Path(__file__).parent
COUNT = 40  # problems of a track; the trajectory has 50 samples
SPIDAR_FORCE_N, SPIDAR_TORQUE_NM = 4.0, 0.02  # of the warm-started track
FORCE_N = 1.5  # of the perturbed track
PERTURBATION = (1e-9, 1e-3)  # moves of the hand in m, and changes of the force as a share of it


def cold(problems: str, shape: tuple[int, int], count: int) -> Group:
    """Return the first problems of one shape of a problem set."""
    for group in problem_set(problems, count).groups:
        if group.structure.shape[1:] == shape:
            part = problem_of(group).take(np.arange(COUNT))
            return Group(group.label, *part.arrays[:4])
    raise ValueError(f"{problems} has no problems of shape {shape}")


def warm() -> Group:
    """Return a force and a torque that turn by 4.5 degrees at a time, at one pose of a device."""
    rig, angle = load_rig("spidar-g6x4"), np.linspace(0.0, np.pi, COUNT, endpoint=False)
    zero = np.zeros(COUNT)
    force = SPIDAR_FORCE_N * np.column_stack([np.cos(angle), np.sin(angle), zero])
    torque = SPIDAR_TORQUE_NM * np.column_stack([np.sin(2.0 * angle), zero, np.cos(2.0 * angle)])
    structure = np.broadcast_to(rig.structure_matrix(rig.home), (COUNT, rig.n, rig.m))
    wrench = np.concatenate([force, torque], axis=1)
    return Group(rig.name, structure, wrench, rig.limits.lower, rig.limits.upper, np.arange(COUNT) - 1)


def perturbed() -> Group:
    """Return forces at the centre of a cube, where many solutions tie, each followed by one a little away."""
    rig, rng = load_rig("cube-8"), np.random.default_rng(0)
    chosen = grid18()[np.linspace(0, 181, COUNT // 2).astype(int)]
    size = np.exp(rng.uniform(*np.log(PERTURBATION), (len(chosen), 1)))
    position = np.stack([0.0 * chosen, size * unit_vectors(rng, len(chosen), 3)], axis=1).reshape(-1, 3)
    wrench = FORCE_N * np.stack([chosen, chosen + size * unit_vectors(rng, len(chosen), 3)], axis=1).reshape(-1, 3)
    row = np.arange(COUNT)
    previous = np.where(row % 2, row - 1, -1)
    return Group(
        rig.name, rig.structure_matrix(rig.home + position), wrench, rig.limits.lower, rig.limits.upper, previous
    )


def trajectory() -> Group:
    """Return one path of the problem set of that name."""
    group = problem_set("trajectory", 200).groups[1]
    return replace(group, previous=np.arange(len(group.wrench)) - 1)


def main() -> None:
    """Write a compressed NPZ file for each track."""
    tracks = {
        "edge-1": cold("edge", (6, 8), 6 * COUNT),
        "robot-1": cold("robots", (6, 8), 4 * COUNT),
        "unreachable-1": cold("unreachable", (3, 8), 5 * COUNT),
        "warm-1": warm(),
        "perturbed-1": perturbed(),
        "trajectory-1": trajectory(),
    }
    for name, group in tracks.items():
        structure, wrench, lower, upper = problem_of(group).arrays[:4]
        previous = np.full(len(wrench), -1) if group.previous is None else group.previous
        arrays = {"structure": structure, "wrench": wrench, "lower": lower, "upper": upper, "previous": previous}
        np.savez_compressed(FOLDER / f"{name}.npz", **arrays)
        print(FOLDER / f"{name}.npz")


if __name__ == "__main__":
    main()
