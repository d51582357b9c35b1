"""Forces and currents measured with a mass, and with a staircase at a force sensor."""

import contextlib
import signal

import numpy as np
import pytest

from tensionlab.errors import CalibrationError, HardwareError, InputError, LinkTimeout, ModuleFault
from tensionlab.hardware.calibration.gain import gain_from_sensor, gain_from_weights
from tensionlab.hardware.calibration.gain_measurement import (
    LEVELS,
    balances,
    climb,
    lag,
    load_sensor,
    load_staircase,
    weigh,
)
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration, State
from tensionlab.hardware.protocol.messages import Calibrate, ConfigureTelemetry, Decoder, SetParameter, read
from tensionlab.hardware.runner.watchdog import STOPPING_SIGNALS
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, HangingMass, SimulatedModule
from tensionlab.model.module import STANDARD_GRAVITY_M_S2
from tensionlab.support.files.tables import table_text
from tensionlab.support.operating_system import ESTOP_SIGNAL
from tests.helpers.examples import many

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
    assert -acceleration * inertia == pytest.approx(
        3.0 - 0.2 * STANDARD_GRAVITY_M_S2 - 0.05 - 0.05 * 1.5, rel=0.05
    )
    with pytest.raises(InputError, match="moves the cable's far end by itself"):
        simulated.advance(0.1, 0.9)


@pytest.mark.slow
def test_planted_gains_are_within_their_intervals():
    inside, friction, sure = [], [], []
    for seed in range(many(25)):
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
    assert sum(inside) >= 0.8 * len(inside)
    assert all(friction)
    assert max(sure) < 0.025


def test_one_mass_is_enough_where_the_zero_is_known_and_a_bad_link_does_no_harm():
    plant, simulated = planted(20, 0.15)
    bad = Conditions(latency=0.03, jitter=0.01, drop=5e-4, corrupt=5e-4)
    with ModuleClient("one", FaultyLink(SimulatedLink(simulated), bad)) as client:
        found = gain_from_weights(weigh(client, 0.15, 4), 3.0)
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


@pytest.mark.parametrize("stage", ["telemetry", "calibrate"])
def test_a_lost_command_leaves_no_module_armable_that_was_never_calibrated(stage):
    simulated = HangingMass(0.1)
    if stage == "telemetry":
        link = Deaf(simulated, lambda said: said == ConfigureTelemetry(0))
    else:
        link = Deaf(simulated, lambda said: isinstance(said, Calibrate), answers=True)
    client = ModuleClient("one", link)
    with contextlib.suppress(LinkTimeout):
        weigh(client, 0.1, 2)
    link.silent = False
    assert simulated.parameters["calibrated"] == 0.0


def test_a_module_that_stays_armable_is_said_to_be():
    simulated = HangingMass(0.1)
    client = ModuleClient("one", Deaf(simulated, lambda said: isinstance(said, SetParameter)))
    with pytest.raises(HardwareError, match='module "one" counts as calibrated though its N/A was never measured'):
        weigh(client, 0.1, 2)


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


def test_a_module_in_use_is_left_alone():
    simulated = HangingMass(0.1)
    with ModuleClient("one", SimulatedLink(simulated)) as client:
        client.calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)
        client.arm()
        with pytest.raises(ModuleFault):
            weigh(client, 0.1, 2)
        assert simulated.sample.state is State.ARMED


AHEAD = 12.34  # s, the sensor's clock
GAIN, FRICTION = 2.6, 0.08


class Bench(SimulatedModule):
    """A module whose cable is tied to a sensor: 100 readings a second, with 10 mN of noise."""

    def __init__(self):
        super().__init__(plant={"torque_constant": GAIN * 0.0195, "dry_friction": FRICTION, "cogging": 0.01})
        self.readings, self._random, self._next = [], np.random.default_rng(0), 0.0
        self.advance(STEP_S)

    def advance(self, seconds, distance=None):
        super().advance(seconds, distance)
        now = self.sample
        if now.seconds >= self._next:
            self._next += 0.01
            self.readings.append((now.seconds + AHEAD, now.tension + self._random.normal(0.0, 0.01)))


@pytest.fixture(scope="module")
def bench():
    module = Bench()
    with ModuleClient("one", SimulatedLink(module)) as client:
        client.listen(2.0)  # the sensor is switched on first
        began = client.link.clock()
        record = climb(client)
        assert client.hello().state is State.IDLE
        client.listen(2.0)
    time, force = np.array(module.readings).T
    return record, time, force, AHEAD + began


def test_the_clocks_are_aligned_by_what_they_saw(bench):
    record, time, force, ahead = bench
    found = lag(record, time, force)
    assert -0.05 < found - ahead < 0.3, "the record begins when the module is armed, which takes a moment"
    assert lag(record, time - 20.0, force) == pytest.approx(found - 20.0, abs=0.02)


def test_gain_and_hysteresis_are_what_was_planted(bench):
    record, time, force, _ = bench
    found = gain_from_sensor(balances(record, time, force, lag(record, time, force)), 3.0)
    assert len(found.balances) == 2 * LEVELS - 2
    assert found.gain.value == pytest.approx(GAIN, rel=0.01)
    assert GAIN in found.gain
    assert found.friction.value == pytest.approx(FRICTION, abs=0.015)
    assert found.zero.value == pytest.approx(0.0, abs=0.01)
    assert found.after < 0.03
    assert found.before > 0.15


def test_record_and_sensor_come_back_from_files(bench, tmp_path):
    record, time, force, _ = bench
    (tmp_path / "staircase.csv").write_text(table_text(vars(record)))
    again = load_staircase(tmp_path / "staircase.csv")
    np.testing.assert_allclose(again.current, record.current)
    lines = [f"{t},{f}" for t, f in zip(time, force, strict=True)]
    (tmp_path / "sensor.csv").write_text("# from the bench\ntime,force\n" + "\n".join(lines) + "\n")
    np.testing.assert_array_equal(load_sensor(tmp_path / "sensor.csv")[1], force)


def test_a_sensor_file_needs_its_columns_and_times_that_grow(tmp_path):
    for text, message in (
        ("time,torque\n1,2\n", 'column "force" is missing'),
        ("time,force\n" + "1,2\n" * 20, "times must grow"),
    ):
        (tmp_path / "sensor.csv").write_text(text)
        with pytest.raises(CalibrationError, match=message):
            load_sensor(tmp_path / "sensor.csv")


def test_a_recording_of_something_else_is_refused(bench):
    record, time, force, ahead = bench
    with pytest.raises(CalibrationError, match="were they recorded together"):
        lag(record, time, np.random.default_rng(0).normal(1.0, 0.5, len(time)))
    with pytest.raises(CalibrationError, match="were they recorded together"):
        lag(record, time, -force)
    early = time < time[len(time) // 2]
    with pytest.raises(CalibrationError, match="start it before the staircase"):
        balances(record, time[early], force[early], ahead)
