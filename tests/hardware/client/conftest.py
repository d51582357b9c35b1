import pytest

from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


@pytest.fixture
def client():
    """Client of a simulated module with a calibrated gain."""
    simulated = SimulatedModule()
    simulated.advance(STEP_S)
    with ModuleClient("one", SimulatedLink(simulated)) as found:
        found.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
        yield found
