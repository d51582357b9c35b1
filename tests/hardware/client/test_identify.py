"""One cable pulses, gently, and only if nobody else uses its module."""

import numpy as np
import pytest

from tensionlab.errors import HardwareError, ModuleFault
from tensionlab.hardware.client.identify import PULSES, STRENGTH, identify
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.simulation.simulated_link import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


@pytest.fixture
def client():
    simulated = SimulatedModule()
    simulated.advance(STEP_S)
    with ModuleClient("one", SimulatedLink(simulated)) as found:
        yield found


@pytest.fixture
def calibrated(client):
    client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
    return client


def test_three_pulses_of_half_a_newton_and_then_nothing(calibrated):
    pulled, advance = [], calibrated.link.module.advance

    def watched(seconds):
        advance(seconds)
        pulled.append(calibrated.link.module.sample.commanded)

    calibrated.link.module.advance = watched
    begun = []
    identify(calibrated, lambda: begun.append(calibrated.state))
    assert begun == [State.ARMED]
    pulled = np.array(pulled)
    assert pulled.max() == pytest.approx(0.5 + STRENGTH)
    strong = pulled > 0.75
    assert np.count_nonzero(np.diff(strong.astype(int)) == 1) == PULSES
    assert calibrated.state is State.IDLE
    assert pulled.size * STEP_S < 3.0


def test_it_is_stopped_if_it_is_interrupted(calibrated):
    def interrupt():
        raise KeyboardInterrupt

    calibrated.check = interrupt
    with pytest.raises(KeyboardInterrupt):
        identify(calibrated, print)
    assert calibrated.state is State.IDLE


def test_a_module_that_somebody_has_armed_is_left_alone(calibrated):
    calibrated.arm()
    with pytest.raises(HardwareError, match='"one" is ARMED: somebody else has it armed; stop it there'):
        identify(calibrated, print)
    assert calibrated.link.module.sample.state is State.ARMED


def test_one_that_let_go_must_be_cleared_but_a_timeout_is_no_obstacle(calibrated):
    calibrated.estop()
    with pytest.raises(ModuleFault, match='"one" is in ESTOP: find out why, then `tensionlab module clear sim:`'):
        identify(calibrated, print)
    calibrated.clear()
    calibrated.arm()
    calibrated.listen(0.4)
    assert calibrated.link.module.sample.state is State.TIMEOUT
    identify(calibrated, print)
    assert calibrated.state is State.IDLE


def test_one_that_is_broken_says_where_to_see_it(calibrated):
    calibrated.link.module.damage("encoder")
    calibrated.listen(0.1)
    with pytest.raises(
        ModuleFault, match=r"FAULT_PRESENT .*; something is wrong with it, see `tensionlab module mon"
    ):
        identify(calibrated, print)


def test_one_that_is_not_calibrated_is_told_what_to_do(client):
    with pytest.raises(
        HardwareError, match="not calibrated, and can't be armed: `tensionlab module calibrate gain"
    ):
        identify(client, print)
