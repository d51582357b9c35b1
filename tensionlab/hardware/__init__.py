"""Real and simulated modules: links to them, their protocol, and the runner that renders forces on them.

Each name is imported where it is first used: a stop waits for no runner.
"""

from typing import TYPE_CHECKING

from tensionlab.hardware.client import links
from tensionlab.support.lazy import importer

if TYPE_CHECKING:
    from tensionlab.demand import Demand, Impedance, Pose, RigState
    from tensionlab.hardware.client.group import ModuleGroup, connect
    from tensionlab.hardware.client.links import load_modules
    from tensionlab.hardware.client.module import ModuleClient
    from tensionlab.hardware.log.reader import Run, read_run
    from tensionlab.hardware.log.writer import RunLog
    from tensionlab.hardware.runner.program import Program, load_program
    from tensionlab.hardware.runner.records import Cycle
    from tensionlab.hardware.runner.runner import Runner
    from tensionlab.hardware.runner.settings import RealClock, RunSettings, WorldClock
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

_NAMES = {
    "tensionlab.demand": ("Demand", "Impedance", "Pose", "RigState"),
    "tensionlab.hardware.client.group": ("ModuleGroup", "connect"),
    "tensionlab.hardware.client.module": ("ModuleClient",),
    "tensionlab.hardware.client.links": ("load_modules",),
    "tensionlab.hardware.log.reader": ("Run", "read_run"),
    "tensionlab.hardware.log.writer": ("RunLog",),
    "tensionlab.hardware.runner.program": ("Program", "load_program"),
    "tensionlab.hardware.runner.runner": ("Runner",),
    "tensionlab.hardware.runner.settings": ("RealClock", "RunSettings", "WorldClock"),
    "tensionlab.hardware.runner.records": ("Cycle",),
    "tensionlab.hardware.simulation.world": ("World",),
}


def __dir__() -> list[str]:
    return sorted(__all__)


def _open_simulated() -> links.Link:
    from tensionlab.hardware.simulation.links import SimulatedLink
    from tensionlab.hardware.simulation.simulated_module import SimulatedModule

    return SimulatedLink(SimulatedModule())


links.OPENERS["sim:"] = _open_simulated
if not TYPE_CHECKING:
    __getattr__ = importer(__name__, _NAMES)
