"""Real and simulated modules: links to them, their protocol, and the runner that renders forces on them.

Each name is imported where it is first used: a stop waits for no runner.

Examples
--------
A `Runner` renders a `Demand` on a `ModuleGroup`, here that of a simulated `World` by its `WorldClock`; `connect`
reaches real ones, which go by a `RealClock`. A `RunLog` keeps each `Cycle`, and `read_run` returns a `Run`.

>>> import numpy as np
>>> import tensionlab as tl
>>> from tensionlab.hardware import *
>>> from tensionlab.support.provenance import manifest
>>> rig, settings = tl.load_rig("bartels2026-validation"), RunSettings(rate=50.0, on_loss="continue")
>>> world, pull = World(rig), Demand(np.array([0.0, 0.0, 1.5]))
>>> links = {module.name: "sim:" for module in rig.modules}
>>> log = RunLog("run.mcap", rig, manifest(["an example"]), "newton", settings, links)
>>> clock = WorldClock(world)
>>> runner = Runner(rig, world.group(), "newton", lambda state: pull, settings, sinks=[log], clock=clock)
>>> _ = runner.run(seconds=1.0)
>>> runner.latest.commanded.round(1)
array([1.5, 2.5, 0.5, 2. ])
>>> state = runner.latest.state  # a `RigState`
>>> state.structure.shape, tl.Status(int(runner.latest.allocation.status)).name
((3, 4), 'EXACT')
>>> run = read_run("run.mcap")
>>> len(run), run.complete, run.to_pandas().shape[0]
(50, True, 50)
"""

from typing import TYPE_CHECKING

from tensionlab.hardware.client import links
from tensionlab.support.lazy import importer

if TYPE_CHECKING:
    from tensionlab.demand import Demand as Demand
    from tensionlab.demand import Impedance as Impedance
    from tensionlab.demand import Pose as Pose
    from tensionlab.demand import RigState as RigState
    from tensionlab.hardware.client.group import ModuleGroup as ModuleGroup
    from tensionlab.hardware.client.group import connect as connect
    from tensionlab.hardware.client.links import load_modules as load_modules
    from tensionlab.hardware.client.module import ModuleClient as ModuleClient
    from tensionlab.hardware.log.reader import Run as Run
    from tensionlab.hardware.log.reader import read_run as read_run
    from tensionlab.hardware.log.writer import RunLog as RunLog
    from tensionlab.hardware.runner.program import Program as Program
    from tensionlab.hardware.runner.program import load_program as load_program
    from tensionlab.hardware.runner.records import Cycle as Cycle
    from tensionlab.hardware.runner.runner import Runner as Runner
    from tensionlab.hardware.runner.settings import RealClock as RealClock
    from tensionlab.hardware.runner.settings import RunSettings as RunSettings
    from tensionlab.hardware.runner.settings import WorldClock as WorldClock
    from tensionlab.hardware.simulation.world import World as World

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
__all__ = [name for names in _NAMES.values() for name in names]


def __dir__() -> list[str]:
    return sorted(__all__)


def _open_simulated() -> links.Link:
    from tensionlab.hardware.simulation.links import SimulatedLink
    from tensionlab.hardware.simulation.simulated_module import SimulatedModule

    return SimulatedLink(SimulatedModule())


links.OPENERS["sim:"] = _open_simulated
if not TYPE_CHECKING:
    __getattr__ = importer(__name__, _NAMES)
