"""N/A, friction and zero from currents that were made up, and from masses that a simulated module lifts."""

import signal
from contextlib import nullcontext

import numpy as np
import pytest

from tensionlab.errors import CalibrationError, HardwareError, ModuleFault
from tensionlab.hardware.calibration.gain import Balance, estimate_gain, weigh
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.protocol.messages import Calibrate, ConfigureTelemetry, Decoder, SetParameter, read
from tensionlab.hardware.runner.watchdog import STOPPING_SIGNALS
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.simulated_module import HangingMass
from tensionlab.model.module import STANDARD_GRAVITY_M_S2
from tensionlab.support.operating_system import ESTOP_SIGNAL
from tests.helpers.examples import many

SPOOL = 0.0195
GAIN, FRICTION, ZERO = 2.7, 0.12, 0.03


def balances(forces, repeats, rng=None):
    """What a module needs for these forces, with 5 mA of noise."""
    return [
        Balance(force, (force + sign * FRICTION) / GAIN + ZERO + (rng.normal(0.0, 0.005) if rng else 0.0), sign)
        for force in forces
        for sign in (1, -1)
        for _ in range(repeats)
    ]


def test_without_noise_all_three_come_back():
    found = estimate_gain(balances([1.0, 2.0], 2), 3.0)
    assert [found.gain.value, found.friction.value, found.zero.value] == pytest.approx([GAIN, FRICTION, ZERO])
    assert found.after == pytest.approx(0.0, abs=1e-9)
    before = [3.0 * each.current - (each.force + FRICTION * each.direction) for each in found.balances]
    assert found.before == pytest.approx(np.sqrt(np.mean(np.square(before))))
    found = estimate_gain(balances([1.0], 4), 3.0)
    assert found.zero is None, "a single weight does not tell it"
    assert found.gain.value == pytest.approx(1.0 / (1.0 / GAIN + ZERO))


def test_intervals_hold_the_truth_95_times_in_100():
    rng = np.random.default_rng(0)
    found = [estimate_gain(balances([1.0, 1.5, 2.0], 3, rng), 3.0) for _ in range(1000)]
    for name, truth in (("gain", GAIN), ("friction", FRICTION), ("zero", ZERO)):
        inside = np.mean([truth in getattr(each, name) for each in found])
        assert inside == pytest.approx(0.95, abs=0.025), name


def test_what_cannot_be_told_is_refused():
    noise = np.random.default_rng(0).normal(0.3, 0.1, 8)
    lost = [Balance(1.0 + index // 4, current, (-1) ** index) for index, current in enumerate(noise)]
    for measured, message in (
        (balances([1.0], 1), "twice in each direction"),
        ([Balance(1.0, 0.3, 1)] * 10, "twice in each direction"),
        (lost, "does not clearly grow"),
    ):
        with pytest.raises(CalibrationError, match=message):
            estimate_gain(measured, 3.0)


def planted(seed, mass=0.1):
    """A module like none of the data sheets."""
    rng = np.random.default_rng(seed)
    plant = {"torque_constant": 0.0585 * rng.uniform(0.8, 1.2), "dry_friction": rng.uniform(0.03, 0.12)}
    plant["cogging"] = rng.uniform(0.0, 0.03)
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
        client.set_tension(3.0, ttl_ms=2000)
        places = [client.listen(0.1) or simulated.sample.distance for _ in range(4)]
    inertia = 0.2 + 1.2e-5 / SPOOL**2
    force = 3.0 - 0.2 * STANDARD_GRAVITY_M_S2 - 0.05 - 0.05 * 1.5
    assert -np.diff(places, 2)[-1] / 0.1**2 * inertia == pytest.approx(force, rel=0.05)


@pytest.mark.slow
def test_planted_gains_are_within_their_intervals():
    inside, friction, sure = [], [], []
    for seed in range(many(25)):
        plant, simulated = planted(seed)
        found = estimate_gain(weighed(simulated, [0.1, 0.2]), 3.0)
        true = plant["torque_constant"] / SPOOL
        inside.append(true in found.gain)
        sure.append(found.gain.half_width / found.gain.value)
        assert found.gain.value == pytest.approx(true, rel=0.02), seed
        assert found.zero.value == pytest.approx(0.0, abs=0.01)
        # Friction counts with the cogging that has to be climbed.
        low, high = plant["dry_friction"], plant["dry_friction"] + plant["cogging"]
        friction.append(low - 0.01 < found.friction.value < high + 0.01)
        assert found.after < 0.02
    assert sum(inside) >= 0.8 * len(inside)
    assert all(friction)
    assert max(sure) < 0.025


def test_a_module_is_weighed_over_a_bad_link_and_left_as_it_was_but_not_while_it_is_armed():
    plant, simulated = planted(20, 0.15)
    bad = Conditions(latency=0.03, jitter=0.01, drop=5e-4, corrupt=5e-4)
    with ModuleClient("one", FaultyLink(SimulatedLink(simulated), bad)) as client:
        assert not client.hello().calibrated
        found = estimate_gain(weigh(client, 0.15, 4), 3.0)
        assert found.gain.value == pytest.approx(plant["torque_constant"] / SPOOL, rel=0.04)
        assert not client.hello().calibrated
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 2.5)
        weigh(client, 0.15, 2)
        info = client.hello()
        assert (info.calibrated, info.newton_per_ampere, info.state) == (True, 2.5, State.IDLE)
        client.arm()
        with pytest.raises(ModuleFault, match="not IDLE"):
            weigh(client, 0.15, 2)
        assert simulated.sample.state is State.ARMED


class Deaf(SimulatedLink):
    """Link that loses the commands of some kind, or the answers to them."""

    def __init__(self, module, lost, *, answers=False):
        super().__init__(module)
        self.lost, self.answers, self.silent = lost, answers, False

    def send(self, content):
        lost = self.lost(read(Decoder().feed(content)[0]))
        self.silent = lost and self.answers
        if not lost or self.answers:
            super().send(content)

    def receive(self, timeout):
        content = super().receive(timeout)
        return b"" if self.silent else content


@pytest.mark.parametrize("stage", ["telemetry", "calibrate", "undo"])
def test_a_lost_command_leaves_no_module_armable_that_was_never_calibrated_or_says_so(stage):
    simulated = HangingMass(0.1)
    lost = {
        "telemetry": lambda said: said == ConfigureTelemetry(0),
        "calibrate": lambda said: isinstance(said, Calibrate),
        "undo": lambda said: isinstance(said, SetParameter),
    }[stage]
    link = Deaf(simulated, lost, answers=stage == "calibrate")
    error = f'module "one" {"counts as calibrated though" if stage == "undo" else "at sim: did not answer"}'
    with nullcontext() if stage == "telemetry" else pytest.raises(HardwareError, match=error):
        weigh(ModuleClient("one", link), 0.1, 2)
    link.silent = False
    assert simulated.parameters["calibrated"] == (stage == "undo")


@pytest.mark.parametrize(
    ("told", "hung", "message"),
    [
        (0.05, 0.05, r"0.05 kg is too light; hang 0.07 to 0.28 kg"),
        (0.5, 0.5, r"0.5 kg is too heavy; hang"),
        (0.1, 0.25, "at 1.97 N its cable does not reel in; is the mass heavier"),
        (0.1, 0.052, "does not pay out; is the mass lighter"),
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


def interrupt(error):
    raise error


@pytest.mark.parametrize(
    ("trouble", "error", "left"),
    [
        (lambda simulated: interrupt(RuntimeError("x")), "x", State.IDLE),
        (lambda simulated: interrupt(KeyboardInterrupt("x")), "x", State.IDLE),
        (lambda simulated: signal.raise_signal(signal.SIGINT), "modules are stopped", State.IDLE),
        (lambda simulated: signal.raise_signal(signal.SIGTERM), "modules are stopped", State.IDLE),
        (
            lambda simulated: signal.raise_signal(ESTOP_SIGNAL),
            "emergency stop; `tensionlab module clear` leads out of it",
            State.ESTOP,
        ),
        (lambda simulated: simulated.damage("encoder"), "has released its cable", State.FAULT),
    ],
)
def test_whatever_ends_it_early_leaves_the_module_stopped(trouble, error, left):
    simulated = HangingMass(0.1)
    before = [signal.getsignal(number) for number in STOPPING_SIGNALS]
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        with pytest.raises((RuntimeError, KeyboardInterrupt, ModuleFault), match=error):
            weigh(client, 0.1, 2, lambda share: trouble(simulated))
        assert client.hello().state is left
        client.listen(0.5)
    assert not simulated.sample.driver_on
    assert [signal.getsignal(number) for number in STOPPING_SIGNALS] == before
