"""A link to a simulated module of this process."""

from __future__ import annotations

from tensionlab.errors import LinkError
from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


class SimulatedLink:
    """A simulated module of this process. Its time passes while somebody waits, and where it is advanced."""

    lockstep = True

    def __init__(self, module: SimulatedModule, url: str = "sim:") -> None:
        self.module = module
        self.url = url
        self._open = True

    def send(self, content: bytes) -> None:
        """Hand bytes over."""
        self._require_open()
        self.module.receive(content)

    def receive(self, timeout: float) -> bytes:
        """Wait for bytes, a step of the firmware at a time."""
        self._require_open()
        steps = int(timeout / STEP_S + 1e-6)
        while not (content := self.module.transmit()) and steps > 0:
            self.module.advance(STEP_S)
            steps -= 1
        return content

    def clock(self) -> float:
        """Time of the module, in s."""
        return self.module.seconds

    def close(self) -> None:
        """Let the firmware know that its link is gone."""
        if self._open:
            self.module.close_link()
        self._open = False

    def _require_open(self) -> None:
        if not self._open:
            raise LinkError(f"{self.url} is closed")


OPENERS["sim:"] = lambda: SimulatedLink(SimulatedModule())
