"""Real and simulated modules: links to them, their protocol, and the runner that renders forces on them."""

from tensionlab.demand import Demand, Impedance, Pose, RigState
from tensionlab.hardware.client.group import ModuleGroup, connect, load_modules
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.log.reader import Run, read_run
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.runner.program import Program, load_program
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RealClock, RunSettings, WorldClock
from tensionlab.hardware.runner.statistics import Cycle
from tensionlab.hardware.simulation.world import World

__all__ = [
    "Cycle",
    "Demand",
    "Impedance",
    "ModuleClient",
    "ModuleGroup",
    "Pose",
    "Program",
    "RealClock",
    "RigState",
    "Run",
    "RunLog",
    "RunSettings",
    "Runner",
    "World",
    "WorldClock",
    "connect",
    "load_modules",
    "load_program",
    "read_run",
]
