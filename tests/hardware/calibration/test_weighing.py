"""A mass on the cable of a simulated module, in lockstep: what it shows is what was planted."""

import signal

import numpy as np
import pytest

from tensionlab.errors import CalibrationError, HardwareError, ModuleFault
from tensionlab.hardware.calibration.gain import GRAVITY, gain_from_weights
from tensionlab.hardware.calibration.hanging import HangingMass
from tensionlab.hardware.calibration.weighing import weigh
from tensionlab.hardware.client.locks import ESTOP_SIGNAL
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.simulation.channel import Conditions
from tensionlab.hardware.simulation.faulty import FaultyLink
from tensionlab.hardware.simulation.simulated_link import SimulatedLink

SPOOL = 0.0195


def planted(seed, mass=0.1):
    """A module like none of the data sheets."""
    rng = np.random.default_rng(seed)
    plant = {
        "torque_constant": 0.0585 * rng.uniform(0.8, 1.2),
        "dry_friction": rng.uniform(0.03, 0.12),
        "cogging": rng.uniform(0.0, 0.03),
    }
    return plant, HangingMass(mass, plant=plant, seed=seed)


def weighed(simulated, masses, repeats=4):
    found = []
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        for mass in masses:
            simulated.mass = mass
            found += weigh(client, mass, repeats)
        assert client.hello().state is State.IDLE
    return found


def test_a_mass_hangs_as_newton_says():
    simulated = HangingMass(0.2)
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
        client.arm()
        client.listen(0.2)
        assert simulated.sample.distance == 1.0, "on the floor"
        places = []
        client.set_tension(3.0, ttl_ms=2000)
        for _ in range(4):
            client.listen(0.1)
            places.append(simulated.sample.distance)
    inertia = 0.2 + 1.2e-5 / SPOOL**2
    acceleration = np.diff(places, 2)[-1] / 0.1**2
    assert -acceleration * inertia == pytest.approx(3.0 - 0.2 * GRAVITY - 0.05 - 0.05 * 1.5, rel=0.05)
    with pytest.raises(HardwareError, match="moves the cable's far end by itself"):
        simulated.advance(0.1, 0.9)


@pytest.mark.slow
def test_planted_gains_are_within_their_intervals():
    inside, friction, sure = [], [], []
    for seed in range(12):
        plant, simulated = planted(seed)
        found = gain_from_weights(weighed(simulated, [0.1, 0.2]), 3.0)
        true = plant["torque_constant"] / SPOOL
        inside.append(true in found.gain)
        sure.append(found.gain.half_width / found.gain.value)
        assert found.gain.value == pytest.approx(true, rel=0.02), seed
        assert found.zero.value == pytest.approx(0.0, abs=0.01)
        # Friction counts with the cogging that has to be climbed.
        low, high = plant["dry_friction"], plant["dry_friction"] + plant["cogging"]
        friction.append(low - 0.01 < found.friction.value < high + 0.01)
        assert found.after < 0.02
    assert sum(inside) >= 10
    assert all(friction)
    assert max(sure) < 0.025


def test_one_mass_is_enough_where_the_zero_is_known():
    plant, simulated = planted(20)
    found = gain_from_weights(weighed(simulated, [0.15]), 3.0)
    assert found.gain.value == pytest.approx(plant["torque_constant"] / SPOOL, rel=0.03)


def test_a_bad_link_does_no_harm():
    plant, simulated = planted(30)
    bad = Conditions(latency=0.03, jitter=0.01, drop=5e-4, corrupt=5e-4)
    with ModuleClient("one", FaultyLink(SimulatedLink(simulated), bad)) as client:
        found = gain_from_weights(weigh(client, 0.1, 2) + weigh(client, 0.1, 2), 3.0)
    assert found.gain.value == pytest.approx(plant["torque_constant"] / SPOOL, rel=0.04)


def test_a_module_that_was_never_calibrated_is_weighed_and_left_so():
    simulated = HangingMass(0.1)
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        assert not client.hello().calibrated
        weigh(client, 0.1, 2)
        assert not client.hello().calibrated
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 2.5)
        weigh(client, 0.1, 2)
        info = client.hello()
    assert info.calibrated
    assert info.newton_per_ampere == 2.5
    assert simulated.sample.state is State.IDLE


@pytest.mark.parametrize(
    ("told", "hung", "message"),
    [
        (0.05, 0.05, r"0.05 kg is too light: hang a mass of 0.07 to 0.28 kg"),
        (0.5, 0.5, r"0.5 kg is too heavy: hang a mass"),
        (0.1, 0.25, "at 1.97 N its cable does not reel in yet; is the mass heavier than was said"),
        (0.1, 0.052, "does not pay out yet; is the mass lighter than was said"),
    ],
)
def test_a_mass_that_does_not_suit_the_module_is_refused_and_the_module_stopped(told, hung, message):
    simulated = HangingMass(hung)
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        with pytest.raises(CalibrationError, match=message):
            weigh(client, told, 2)
        assert client.hello().state is State.IDLE
        client.listen(0.5)
    assert not simulated.sample.driver_on


def test_a_module_that_breaks_meanwhile_says_so_and_lets_go():
    simulated = HangingMass(0.1)
    with ModuleClient("one", SimulatedLink(simulated)) as client:

        def break_it(share):
            simulated.damage("encoder")

        with pytest.raises(ModuleFault, match="has released its cable"):
            weigh(client, 0.1, 3, break_it)
    assert not simulated.sample.driver_on


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError])
def test_whoever_interrupts_leaves_the_module_stopped(error):
    simulated = HangingMass(0.1)

    def interrupt(share):
        raise error

    with ModuleClient("one", SimulatedLink(simulated)) as client:
        with pytest.raises(error):
            weigh(client, 0.1, 2, interrupt)
        assert client.state is State.IDLE


@pytest.mark.parametrize(
    ("number", "left"), [(signal.SIGINT, State.IDLE), (signal.SIGTERM, State.IDLE), (ESTOP_SIGNAL, State.ESTOP)]
)
def test_a_signal_stops_the_module_and_ends_it(number, left):
    simulated = HangingMass(0.1)
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        before = signal.getsignal(number)
        with pytest.raises(KeyboardInterrupt):
            weigh(client, 0.1, 2, lambda share: signal.raise_signal(number))
        assert client.hello().state is left
        assert signal.getsignal(number) is before


def test_a_module_that_somebody_else_pulls_with_is_left_alone():
    simulated = HangingMass(0.1)
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
        client.arm()
        with pytest.raises(ModuleFault):
            weigh(client, 0.1, 2)
        assert simulated.sample.state is State.ARMED
