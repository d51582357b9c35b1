"""A simulated module that pulls at a force sensor, whose clock and file are its own."""

import numpy as np
import pytest

from tensionlab.errors import CalibrationError
from tensionlab.hardware.calibration.gain import gain_from_sensor
from tensionlab.hardware.calibration.staircase import (
    LEVELS,
    balances,
    climb,
    lag,
    load_sensor,
    load_staircase,
)
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.simulation.simulated_link import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule

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
    record.save(tmp_path / "staircase.csv")
    again = load_staircase(tmp_path / "staircase.csv")
    np.testing.assert_allclose(again.current, record.current)
    lines = [f"{t},{f}" for t, f in zip(time, force, strict=True)]
    (tmp_path / "sensor.csv").write_text("# from the bench\ntime,force\n" + "\n".join(lines) + "\n")
    np.testing.assert_array_equal(load_sensor(tmp_path / "sensor.csv")[1], force)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,torque\n1,2\n", 'column "force" is missing'),
        ("time,force\n1,2\n2,x\n", r'line 3, column "force": \'x\' is no finite number'),
        ("time,force\n1,2\n2\n", "line 3 has 1 values for 2 columns"),
        ("time,force,heat\n1,2,3\n", 'nobody knows what the column "heat" is'),
        ("time,force,force\n1,2,3\n", 'column "force" is there twice'),
        ("time,force\n", "no numbers"),
        ("time,force\n" + "1,2\n" * 20, "times must grow"),
    ],
)
def test_a_sensor_file_that_is_none_says_where(tmp_path, text, message):
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
