"""Modules that are served with the person who holds their cables, and a host that plays scenarios on them."""

from collections.abc import Mapping
from contextlib import nullcontext

import pytest

from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.osc import OscServer, bundle_of
from tensionlab.haptics.bridge.source import tracked_pose
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.scenarios.play import ScenarioModules, ScenarioResult, needs_tracker, play
from tensionlab.scenarios.scenario import Scenario
from tests.helpers.served import Simulation


class ServedPerson:
    """Person at simulated modules, whom a tracker follows over OSC; clock of all of them, and of the host.

    Attributes
    ----------
    ignored : list
        What of the tracker's datagrams was ignored, and why.
    """

    def __init__(self, scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
        self._scenario, self.ignored = scenario, []
        self._osc: OscServer | None = None
        self._spans: list[tuple[float, float]] = []
        monkeypatch.setattr("tensionlab.cli.simulate.OscTracker", lambda *where: nullcontext(self))
        self.simulation = Simulation("--scenario", scenario.name, "--tracker", "127.0.0.1:9000")

    def send(self, bodies: Mapping, when: float) -> None:
        """Send a datagram to the host, if there is one, as `OscTracker` does."""
        if self._osc is not None:
            self._osc.receive(bundle_of(bodies, when), "127.0.0.1")

    def now(self) -> float:
        """Return the time."""
        return self.simulation.time.perf_counter()

    def wait_until(self, when: float) -> None:
        """Let time pass until then."""
        if self._starved():
            self.simulation.time.jump(max(when - self.now(), 0.0))
        else:
            self.simulation.time.sleep(when - self.now())

    def starve(self, *spans: tuple[float, float]) -> None:
        """Let the server do nothing from one time to another, in s from now, while the host goes on."""
        begin, server = self.now(), self.simulation.time.server
        self._spans = [(begin + first, begin + last) for first, last in spans]
        step = server.step
        server.step = lambda: None if self._starved() else step()

    def _starved(self) -> bool:
        return any(begin <= self.now() < end for begin, end in self._spans)

    def play(self, seconds: float) -> ScenarioResult:
        """Play the scenario as a host that has just come."""
        client, rig = ClientState(self._scenario.rig, self.now), self._scenario.rig
        self._osc = OscServer(client, "127.0.0.1", 0, self.ignored.append)
        group = ModuleGroup([ModuleClient(each.name, self.simulation.link(each.name)) for each in rig.modules])
        tracker = tracked_pose(client) if needs_tracker(rig) else None
        try:
            modules = ScenarioModules(group, self, self.simulation.links, tracker)
            return play(self._scenario, modules, seconds=seconds)
        finally:
            group.close()
            self._osc._socket.close()
            self._osc = None
