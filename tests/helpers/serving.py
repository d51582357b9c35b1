"""Simulated modules served over TCP by a thread of this process, for hosts in processes of their own."""

import threading
from typing import NamedTuple

from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.simulation.serve import ServedModule, Server, TcpPort, serve
from tensionlab.hardware.simulation.world import World

ROW_S = 5e-3
TIMEOUT_S = 60.0


class Row(NamedTuple):
    """What the modules do at a time in s by their own clocks; tensions are commanded, in N."""

    time: float
    states: tuple[State, ...]
    tensions: tuple[float, ...]


class ServedRig:
    """Modules of a rig, served until it is closed.

    Attributes
    ----------
    links : dict
        Their URLs, by name.
    rows : list of Row
        What they did so far.
    """

    def __init__(self, rig, names=None):
        modules = {
            module.name: simulated
            for module, simulated in zip(rig.modules, World(rig).modules, strict=True)
            if names is None or module.name in names
        }
        served = [ServedModule(module, TcpPort()) for module in modules.values()]
        self.links = dict(zip(modules, (each.port.url for each in served), strict=True))
        self.rows = []
        self._more, self._stopped = threading.Condition(), threading.Event()
        self._modules = list(modules.values())
        self._thread = threading.Thread(target=serve, args=(Server(served), self._note))
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._stopped.set()
        self._thread.join()

    @property
    def now(self):
        """Time by the modules' clocks, in s."""
        return self.rows[-1].time

    def wait_for(self, condition):
        """Wait until the latest row is as it should be."""
        with self._more:
            assert self._more.wait_for(lambda: self.rows and condition(self.rows[-1]), TIMEOUT_S)

    def _note(self):
        """Note a row if it is time to; return whether serving is to end."""
        now = self._modules[0].seconds
        if self.rows and now < self.rows[-1].time + ROW_S:
            return self._stopped.is_set()
        samples = [module.sample for module in self._modules]
        with self._more:
            states, tensions = (each.state for each in samples), (each.commanded for each in samples)
            self.rows.append(Row(now, tuple(states), tuple(tensions)))
            self._more.notify_all()
        return self._stopped.is_set()
