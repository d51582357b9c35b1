"""Checks of modules while they follow set-points."""

from dataclasses import replace

import pytest

from tensionlab.errors import ModuleFault
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.protocol.messages import Stop
from tensionlab.hardware.runner.module_monitor import require_following
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


def test_a_module_that_somebody_else_stopped_does_not_follow_any_more():
    simulated = SimulatedModule()
    simulated.advance(STEP_S)
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
        client.telemetry_every(10)
        client.arm()
        for _ in range(5):
            client.set_tension(2.0)
            client.listen(0.02)
        require_following(client)
        simulated.receive(Stop().frame(99).pack())
        client.listen(0.05)
        with pytest.raises(
            ModuleFault, match='"one" is IDLE: somebody else stopped it, or it started anew'
        ) as caught:
            require_following(client)
        assert caught.value.code is State.IDLE


class InterruptedLink(SimulatedLink):
    """Link that hands over `first` before anything that the module sends."""

    first = b""

    def receive(self, timeout):
        first, self.first = self.first, b""
        return first or super().receive(timeout)


@pytest.mark.parametrize("seed", [177, 278], ids=["ARM has number 0", "ARM has number 255"])
def test_telemetry_of_before_it_was_armed_is_not_taken_for_a_stop(seed):
    """Whatever numbers the set-points have: an idle module that never followed one reports 0."""
    simulated = SimulatedModule()
    simulated.advance(STEP_S)
    link = InterruptedLink(simulated)
    with ModuleClient("one", link, seed=seed) as client:
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
        client.telemetry_every(10)
        client.listen(0.05)
        idle = client.telemetry.message
        client.arm()
        client.set_tension(2.0)
        link.first = replace(idle, time_us=idle.time_us + 10).frame(0).pack()
        client.listen()
        assert client.state is State.IDLE
        require_following(client)
        client.listen(0.05)
        assert client.state is State.RUNNING
        require_following(client)
