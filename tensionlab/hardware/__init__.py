"""Real and simulated modules: links to them, their protocol, and the runner that renders forces on them."""

from tensionlab.demand import Demand, Impedance, Pose, RigState
from tensionlab.hardware.group import ModuleGroup, connect
from tensionlab.hardware.log import RunLog
from tensionlab.hardware.module import ModuleClient
from tensionlab.hardware.modules_file import load_modules
from tensionlab.hardware.record.run import Run, read_run
from tensionlab.hardware.run.clock import RealClock, WorldClock
from tensionlab.hardware.run.cycle import Cycle
from tensionlab.hardware.run.program import Program, load_program
from tensionlab.hardware.run.settings import RunSettings
from tensionlab.hardware.runner import Runner
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
