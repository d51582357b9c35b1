"""Rig in this process whose links and modules can be made to fail in the middle of a run."""

from dataclasses import dataclass, field

import numpy as np

import tensionlab as tl
from tensionlab.demand import Demand
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.world import World
from tests.helpers.breakable import BreakableLink

# A force that no cable of the published rig needs more than 1.5 N for: a slew's way in one cycle.
GENTLE = np.array([0.0, 0.0, 0.5])
TROUBLE = 0.5  # when things go wrong, in s


@dataclass
class Rehearsal:
    """Simulated world with a faulty link to each module."""

    rig: tl.Rig
    motion: object = None
    trouble_at: float | None = None
    cycles: list = field(default_factory=list)

    def __post_init__(self):
        self.world = World(self.rig, self.motion)
        self.links = {
            module.name: BreakableLink(SimulatedLink(simulated))
            for module, simulated in zip(self.rig.modules, self.world.modules, strict=True)
        }
        self.group = ModuleGroup([ModuleClient(name, link) for name, link in self.links.items()])
        self.clock = WorldClock(self.world)

    def module(self, name):
        return self.world.modules[list(self.links).index(name)]

    def demand(self, wrench=GENTLE, trouble=lambda: None):
        """Return a demand of a wrench that makes trouble once, at its time."""

        def demand(state):
            self.cycles.append(state)
            if self.trouble_at is None and state.time >= TROUBLE:
                self.trouble_at = self.world.time
                return trouble() or Demand(wrench)
            return Demand(wrench)

        return demand

    def runner(self, demand, solver="newton", sinks=(), clock=None, tracker=None, **settings):
        return Runner(
            self.rig, self.group, solver, demand, RunSettings(**settings), sinks=sinks, clock=clock or self.clock,
            tracker=tracker,
        )  # fmt: skip

    def let_pass(self, until):
        """Let time pass without a host, and return the largest tension of a driven module then, in N."""
        self.world.advance(max(until - self.world.time, 0.0))
        samples = [module.sample for module in self.world.modules]
        return max([sample.commanded for sample in samples if sample.driver_on], default=0.0)

    def states(self):
        return {name: State(self.module(name).sample.state).name for name in self.links}
