"""How a scenario is played: what modules are set to meanwhile."""

from contextlib import suppress

import tensionlab as tl
from tensionlab.hardware.client.group import temporary_slew
from tensionlab.hardware.simulation.world import World


def test_modules_are_as_fast_as_they_must_be_and_then_as_before_whatever_happens():
    group = World(tl.load_rig("datasets/rigs/bartels2026-validation.toml")).group()
    group.clients[1].set_parameter("slew", 100.0)

    def slews():
        return [client.parameter("slew") for client in group.clients]

    before = slews()
    for slew, now in ((300.0, [300.0] * 4), (None, before)):
        with suppress(KeyboardInterrupt), temporary_slew(group, slew):
            assert slews() == now
            raise KeyboardInterrupt
        assert slews() == before == [60.0, 100.0, 60.0, 60.0]
