"""MuJoCo against the rig model, and solvers in a loop with MuJoCo: python -m benchmarks.mujoco_loop."""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np

import tensionlab as tl
from tensionlab.interop.mjcf import rig_to_mjcf
from tensionlab.model import kinematics
from tensionlab.mujoco import TendonAllocator, structure_matrix

RIGS = ("bartels2026-validation", "kntu-planar", "ipanema-1", "ipanema-2", "cogiro")
SOLVERS = ("newton", "dykstra", "qp")
EXAMPLE = Path(__file__).parents[1] / "examples" / "mujoco" / "controller.py"


def disagreement(name: str, poses: int, seed: int = 0) -> tuple[float, float]:
    """Return the largest difference of lengths, in m, and of structure matrices between MuJoCo and a rig.

    Poses are within a tenth of the anchors' extent about home, and turned by up to 0.3 rad about each axis.
    """
    rig = tl.load_rig(name)
    model = mujoco.MjModel.from_xml_string(rig_to_mjcf(rig))
    data = mujoco.MjData(model)
    tendons = [module.name for module in rig.modules]
    rng = np.random.default_rng(seed)
    worst = np.zeros(2)
    for _ in range(poses):
        data.qpos[: rig.dimension] = rig.home + rng.uniform(-0.1, 0.1, rig.dimension) * np.ptp(rig.anchors, axis=0)
        turn = rng.uniform(-0.3, 0.3, 3)
        rotation = None
        if rig.kind == "platform":
            rotation = kinematics.exponential(turn)
            mujoco.mju_mat2Quat(data.qpos[3:], rotation.ravel())
        elif rig.kind == "planar":
            data.qpos[2] = turn[2]
            rotation = turn[2]
        mujoco.mj_forward(model, data)
        pose = (data.qpos[: rig.dimension], rotation)
        lengths = np.abs(data.ten_length - rig.lengths(*pose)).max()
        matrices = np.abs(structure_matrix(model, data, tendons, "platform") - rig.structure_matrix(*pose)).max()
        worst = np.maximum(worst, [lengths, matrices])
    return float(worst[0]), float(worst[1])


def example() -> ModuleType:
    """Return the example's controller as a module."""
    spec = importlib.util.spec_from_file_location("mujoco_controller", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def path_error(controller: ModuleType, solver: str) -> float:
    """Return how far from its path the example's platform is at most while it moves along it, in m."""
    found, _, error, *_ = controller.simulate(solver)
    moving = (found >= controller.HOLD_S) & (found <= controller.HOLD_S + controller.PATH_S)
    return float(error[moving].max())


def step_times(controller: ModuleType, solver: str, steps: int) -> dict[str, float]:
    """Return the median times in µs of a step's parts along the example's path."""
    model = mujoco.MjModel.from_xml_path(str(EXAMPLE.with_name("platform.xml")))
    data = mujoco.MjData(model)
    body = model.body(controller.BODY).id
    tendons = [model.tendon(index).name for index in range(model.ntendon)]
    allocate = TendonAllocator(model, tendons, controller.BODY, solver=solver, reference=20.0)
    taken: dict[str, list[float]] = {"physics": [], "structure": [], "allocate": []}

    def timed(part: str, call: Callable[..., Any], *arguments: Any) -> None:
        start = time.perf_counter()
        call(*arguments)
        taken[part].append(time.perf_counter() - start)

    def physics() -> None:
        mujoco.mj_step2(model, data)
        mujoco.mj_step1(model, data)

    mujoco.mj_step1(model, data)
    for _ in range(steps):
        wrench = controller.follow(model, data, body, data.time + controller.HOLD_S)
        timed("structure", structure_matrix, model, data, tendons, controller.BODY)
        timed("allocate", allocate, data, wrench)
        timed("physics", physics)
    return {part: 1e6 * float(np.median(each)) for part, each in taken.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=1000, help="of each rig")
    parser.add_argument("--steps", type=int, default=2000, help="of which the time is the median")
    options = parser.parse_args(arguments)
    print(f"MuJoCo {mujoco.__version__} against the rig model, largest difference at {options.poses} poses")
    print(f"{'rig':<24}{'lengths m':>12}{'structure':>12}")
    for name in RIGS:
        lengths, matrices = disagreement(name, options.poses)
        print(f"{name:<24}{lengths:>12.1e}{matrices:>12.1e}")
    controller = example()
    print("\nA platform of 6 kg on eight cables, four of them over pulleys, at 500 Hz; median times")
    print(f"{'solver':<10}{'error mm':>10}{'physics µs':>12}{'W µs':>12}{'W, solve µs':>12}")
    for solver in SOLVERS:
        error = 1e3 * path_error(controller, solver)
        times = step_times(controller, solver, options.steps)
        parts = "".join(f"{each:>12.0f}" for each in times.values())
        print(f"{solver:<10}{error:>10.3f}{parts}")


if __name__ == "__main__":
    main()
