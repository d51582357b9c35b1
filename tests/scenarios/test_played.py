"""The scenarios feel as they should, on simulated modules with a simulated person."""

import pytest

from tensionlab.hardware.simulation.channel import Conditions
from tensionlab.scenarios import SCENARIOS, load_scenario
from tensionlab.scenarios.direction import directions
from tensionlab.scenarios.expected import expected
from tensionlab.scenarios.play import play, simulated


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.02])
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_feels_as_it_should_even_over_a_slow_link(name, delay):
    scenario = load_scenario(name)
    modules = simulated(scenario, Conditions(delay) if delay else None)
    played = play(scenario, modules)
    modules.group.close()
    assert played.statistics.ended == "duration reached"
    assert not played.statistics.lost
    rows = expected(played)
    assert rows
    for row in rows:
        assert row.met, row
    where = directions(played.run)
    assert where.reasons["unexplained"] == 0
    assert where.within + sum(where.reasons.values()) == where.judged
    assert where.within > 0.95 * (where.judged - where.reasons["none intended"])
