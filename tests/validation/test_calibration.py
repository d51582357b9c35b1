import numpy as np
import pytest

import tensionlab as tl
from tensionlab.model.layouts import ring_plus_top
from tensionlab.validation.calibration import MODELS, any_map, cables, gains_and_biases, one_gain
from tensionlab.validation.error_model import ErrorModel, draw
from tensionlab.validation.protocol import BASIS, Protocol
from tensionlab.validation.quasi_static import settled, wandering

RIG = ring_plus_top(1.0)
STRUCTURE = RIG.structure_matrix(RIG.home)
PROTOCOL = Protocol()
CHOSEN = tl.allocate(STRUCTURE, PROTOCOL.forces, RIG.limits)
TENSIONS = CHOSEN.tensions[BASIS:]


def felt(errors, noise=None):
    """Forces of a rig with errors, in the axes of the nominal one; no rotation to be found."""
    noise = np.zeros((len(PROTOCOL.forces), 3)) if noise is None else noise
    return settled(RIG, errors, CHOSEN.tensions, CHOSEN.wrench[:BASIS], noise, rotation=np.eye(3)).forces


def felt_part(biases):
    """What of the biases can be felt at the point."""
    return np.linalg.pinv(STRUCTURE) @ STRUCTURE @ biases


def test_planted_gains_and_biases_come_back_within_their_intervals():
    """Nineteen of twenty intervals of 95 % hold the planted number, with other noise for each force."""
    hits = []
    for seed in range(50):
        errors = draw(ErrorModel(gain=1.28, gain_spread=0.08, bias=0.12), RIG.m, seed)
        noise = 0.03 * np.random.default_rng(seed).standard_normal((len(PROTOCOL.forces), 3))
        found = cables(STRUCTURE, TENSIONS, felt(errors, noise))
        assert max(each.half_width for each in (*found.gains, *found.biases)) < 0.05
        hits += [gain in each for gain, each in zip(errors.gains, found.gains, strict=True)]
        hits += [bias in each for bias, each in zip(felt_part(errors.biases), found.biases, strict=True)]
    assert 0.92 < np.mean(hits) < 0.98


def test_without_noise_they_come_back_as_they_are():
    errors = draw(ErrorModel(gain=1.1, gain_spread=0.1, bias=0.2), RIG.m, 4)
    found = cables(STRUCTURE, TENSIONS, felt(errors))
    assert [each.value for each in found.gains] == pytest.approx(errors.gains, abs=1e-9)
    assert [each.value for each in found.biases] == pytest.approx(felt_part(errors.biases), abs=1e-9)


def test_each_model_explains_what_it_is_made_for():
    common = felt(draw(ErrorModel(gain=1.3), RIG.m, 0))
    assert np.allclose(one_gain(STRUCTURE, TENSIONS, common).map, 1.3 * STRUCTURE)
    each = draw(ErrorModel(gain_spread=0.1, bias=0.1), RIG.m, 0)
    model = gains_and_biases(STRUCTURE, TENSIONS, felt(each))
    assert np.allclose(model.map, STRUCTURE * each.gains)
    assert np.allclose(model.offset, STRUCTURE @ each.biases)
    moved = draw(ErrorModel(gain=1.2, bias=0.1, position=0.03, tilt=4.0), RIG.m, 0)
    forces = felt(moved)
    model = any_map(STRUCTURE, TENSIONS, forces)
    assert np.allclose(TENSIONS @ model.map.T + model.offset, forces)


def test_with_all_errors_more_of_a_model_explains_more():
    errors = draw(ErrorModel(1.28, 0.08, 0.12, 0.025, 3.0, 0.1, 0.03), RIG.m, 1)
    forces = felt(errors, wandering(errors.noise, 1, PROTOCOL))
    left = [
        np.linalg.norm(forces - TENSIONS @ model.map.T - model.offset)
        for model in (find(STRUCTURE, TENSIONS, forces) for find in MODELS.values())
    ]
    assert left == sorted(left, reverse=True)
