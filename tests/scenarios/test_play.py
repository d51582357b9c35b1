"""How a scenario is played: what modules are set to meanwhile."""

import pytest

import tensionlab as tl
from tensionlab.hardware.simulation.world import World
from tensionlab.scenarios.play import temporary_slew


@pytest.fixture
def group():
    return World(tl.load_rig("datasets/rigs/bartels2026-validation.toml")).group()


def slews(group):
    return [client.parameter("slew") for client in group.clients]


def test_modules_are_as_fast_as_they_must_be_and_then_as_before(group):
    group.clients[1].set_parameter("slew", 100.0)
    before = slews(group)
    with temporary_slew(group, 300.0):
        assert slews(group) == [300.0] * 4
    assert slews(group) == before == [60.0, 100.0, 60.0, 60.0]
    with temporary_slew(group, None):
        assert slews(group) == before


def test_they_are_set_back_whatever_happens(group):
    with pytest.raises(KeyboardInterrupt), temporary_slew(group, 300.0):
        raise KeyboardInterrupt
    assert slews(group) == [60.0] * 4
