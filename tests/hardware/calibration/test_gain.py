"""N/A, friction and zero from forces and currents that were made up."""

from dataclasses import replace

import numpy as np
import pytest

from tensionlab.errors import CalibrationError
from tensionlab.hardware.calibration.gain import Balance, gain_from_sensor, gain_from_weights

GAIN, FRICTION, ZERO = 2.7, 0.12, 0.03


def balances(forces, repeats, rng=None):
    """What a module needs for these forces, with 5 mA of noise."""
    return [
        Balance(force, (force + sign * FRICTION) / GAIN + ZERO + (rng.normal(0.0, 0.005) if rng else 0.0), sign)
        for force in forces
        for sign in (1, -1)
        for _ in range(repeats)
    ]


@pytest.mark.parametrize("method", [gain_from_weights, gain_from_sensor])
def test_without_noise_all_three_come_back(method):
    found = method(balances([1.0, 2.0], 2), 3.0)
    assert found.gain.value == pytest.approx(GAIN, abs=1e-9)
    assert found.friction.value == pytest.approx(FRICTION, abs=1e-9)
    assert found.zero.value == pytest.approx(ZERO, abs=1e-9)
    assert found.after == pytest.approx(0.0, abs=1e-9)
    before = [3.0 * each.current - (each.force + FRICTION * each.direction) for each in found.balances]
    assert found.before == pytest.approx(np.sqrt(np.mean(np.square(before))))


@pytest.mark.parametrize("method", [gain_from_weights, gain_from_sensor])
def test_intervals_hold_the_truth_95_times_in_100(method):
    rng = np.random.default_rng(0)
    found = [method(balances([1.0, 1.5, 2.0], 3, rng), 3.0) for _ in range(1000)]
    for name, truth in (("gain", GAIN), ("friction", FRICTION), ("zero", ZERO)):
        inside = np.mean([truth in getattr(each, name) for each in found])
        assert inside == pytest.approx(0.95, abs=0.025), name


@pytest.mark.parametrize("method", [gain_from_weights, gain_from_sensor])
@pytest.mark.parametrize("share", [1e-4, 1e4])
def test_currents_in_another_unit_change_the_unit_of_the_gain(method, share):
    measured = balances([1.0, 2.0], 3, np.random.default_rng(0))
    scaled = [replace(each, current=share * each.current) for each in measured]
    assert method(scaled, 3.0).gain.lower == pytest.approx(method(measured, 3.0).gain.lower / share)


def test_a_single_weight_tells_no_zero():
    found = gain_from_weights(balances([1.0], 4), 3.0)
    assert found.zero is None
    assert found.gain.value == pytest.approx(1.0 / (1.0 / GAIN + ZERO))


def test_what_cannot_be_told_is_refused():
    with pytest.raises(CalibrationError, match="twice in each direction"):
        gain_from_weights(balances([1.0], 1), 3.0)
    with pytest.raises(CalibrationError, match="twice in each direction"):
        gain_from_sensor([Balance(1.0, 0.3, 1)] * 10, 3.0)
    noise = np.random.default_rng(0).normal(0.3, 0.1, 8)
    lost = [Balance(1.0 + index // 4, current, (-1) ** index) for index, current in enumerate(noise)]
    with pytest.raises(CalibrationError, match="does not grow"):
        gain_from_weights(lost, 3.0)
    with pytest.raises(CalibrationError, match="does not grow"):
        gain_from_sensor(lost, 3.0)
