"""Run simulated modules with their firmware, in their own time, and read the log of the run."""

import tempfile
from pathlib import Path

import numpy as np

import tensionlab as tl
from tensionlab.hardware import Demand, Pose, RigState, RunLog, Runner, RunSettings, World, WorldClock, read_run
from tensionlab.support.provenance import manifest

rig = tl.load_rig("bartels2026-validation")


def hand(time: float) -> Pose:
    """Return where the hand is: on a circle of 5 cm."""
    return Pose(rig.home + 0.05 * np.array([np.cos(time) - 1.0, 0.0, np.sin(time)]))


def demand(state: RigState) -> Demand:
    """Return the desired force of this cycle: 1 N that turns."""
    angle = 3.0 * state.time
    return Demand(np.array([np.cos(angle), 0.4, np.sin(angle)]))


world, settings = World(rig, hand), RunSettings(rate=50.0)
file = Path(tempfile.mkdtemp()) / "run.mcap"
links = {module.name: "sim:" for module in rig.modules}
log = RunLog(file, rig, manifest(["12_run_modules.py"]), "newton", settings, links)
statistics = Runner(rig, world.group(), "newton", demand, settings, sinks=[log], clock=WorldClock(world)).run(2.0)
run = read_run(file)
print(statistics)
print(f"mean error of the tensions: {np.abs(run.measured - run.commanded)[10:].mean():.3f} N")
