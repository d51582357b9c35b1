"""The quasi-static model is the full protocol on stepped modules, worked out faster."""

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.model.directions import grid18
from tensionlab.model.layouts import ring_plus_top
from tensionlab.validation.error_model import PRESETS, draw_errors
from tensionlab.validation.protocol import AXIS_FORCES, Protocol, measure
from tensionlab.validation.quasi_static import friction_play, mean_noise, predict_forces
from tensionlab.validation.simulated_sensor import DriftNoise, simulated_setup


@pytest.mark.parametrize(
    ("seed", "side", "solver", "protocol"),
    [
        (0, 1.0, "newton", Protocol(hold=0.4)),
        (1, 0.5, "newton", Protocol(hold=0.4, directions=grid18()[::-7])),
        (2, 2.0, "closed-form", Protocol(hold=0.6, directions=grid18()[::25])),
    ],
)
def test_the_quasi_static_model_equals_the_protocol_on_stepped_modules(seed, side, solver, protocol):
    rig = ring_plus_top(side)
    errors = draw_errors(PRESETS["paper-like"], rig.m, seed)
    modules, clock, sensor = simulated_setup(rig, errors, seed)
    found = []
    measure(rig, modules, clock, sensor, solver, protocol, found.append)
    modules.close()
    assert not any(each.rested for each in found)
    chosen = tl.allocate(rig.structure_matrix(rig.home), protocol.forces, rig.limits, solver=solver)
    assert np.allclose([each.tensions for each in found], chosen.tensions, atol=1e-6)
    noise = mean_noise(errors.noise, seed, protocol)
    quick = predict_forces(rig, errors, chosen.tensions, chosen.wrench[:AXIS_FORCES], noise)
    assert np.abs(quick.sensor - [each.measured for each in found]).max() < 1e-5  # in N


def test_play_follows_with_a_lag_and_ignores_less():
    pulls = np.array([[1.0], [1.15], [2.0], [1.85], [1.7]])
    assert friction_play(pulls, np.array([0.5]), 0.1)[:, 0].tolist() == pytest.approx([0.9, 1.05, 1.9, 1.9, 1.8])
    assert np.array_equal(friction_play(pulls, np.array([0.5]), 0.0), pulls)


def test_noise_drifts_by_so_much_in_pieces_of_any_size():
    whole = DriftNoise(0.03, 5).take(3000)
    process = DriftNoise(0.03, 5)
    assert np.allclose(np.concatenate([process.take(count) for count in (1, 7, 0, 992, 2000)]), whole, atol=1e-12)
    many = np.array([DriftNoise(0.03, seed).take(2001)[[0, 1000, 2000]] for seed in range(400)])
    assert many.std(axis=0) == pytest.approx(0.03, rel=0.15)
    shared = np.mean(many[:, 0] * many[:, 1]) / 0.03**2
    assert shared == pytest.approx(np.exp(-1.0), abs=0.1)  # after a second
