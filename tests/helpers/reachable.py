"""Simulated modules of this process, behind URLs as `tensionlab simulate` prints them."""

from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.simulation.links import Conditions, SimulatedLink
from tensionlab.hardware.simulation.world import World
from tensionlab.model.rig import Rig
from tests.helpers.breakable import BreakableLink


class ReachableRig:
    """Modules of a rig that verbs reach at `urls`; the time of each passes while its client waits.

    Attributes
    ----------
    world : World
    urls : dict
        By the modules' names.
    links : dict
        The link that was opened last, by the modules' names.
    """

    def __init__(self, monkeypatch, rig: Rig, conditions: Conditions | None = None, seed: int = 0) -> None:
        self.world = World(rig)
        self.urls, self.links = {}, {}
        self._conditions, self._seed = conditions, seed
        for index, module in enumerate(rig.modules):
            url = self.urls[module.name] = f"socket://127.0.0.1:{40001 + index}"
            monkeypatch.setitem(OPENERS, url, lambda name=module.name, index=index: self._open(name, index))

    def cut(self, name: str) -> None:
        """Break the link to a module."""
        self.links[name].cut()

    def _open(self, name: str, index: int) -> BreakableLink:
        inner = SimulatedLink(self.world.modules[index], self.urls[name])
        link = self.links[name] = BreakableLink(inner, self._conditions, seed=self._seed + index)
        return link
