"""Links that break or fall silent when a test says so."""

from tensionlab.errors import LinkError
from tensionlab.hardware.simulation.links import FaultyLink


class BreakableLink(FaultyLink):
    """Faulty link that can be cut, and frozen."""

    broken = frozen = False

    def cut(self):
        """Break the link: its user gets a `LinkError`, and the module finds it closed."""
        self.broken = True
        self.inner.close()

    def freeze(self):
        """Lose all bytes silently from now on, and those under way."""
        self.frozen = True
        self._outbound.clear()
        self._inbound.clear()

    def send(self, content):
        self._require_whole()
        if not self.frozen:
            super().send(content)

    def receive(self, timeout):
        self._require_whole()
        if not self.frozen:
            return super().receive(timeout)
        end = self.clock() + timeout
        while (left := end - self.clock()) > 1e-4 and self.inner.receive(left):
            pass
        return b""

    def _require_whole(self):
        if self.broken:
            raise LinkError(f"{self.url} broke: it was cut")
