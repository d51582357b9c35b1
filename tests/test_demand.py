"""Softened parameters of effects, as they begin, change and end."""

import numpy as np

from tensionlab.demand import EffectDemand, SoftenedEffects


def told(rendered, rate=50.0):
    """Return times and values told of a wall of 200 N/m whose stiffness is rendered so; None: as desired."""
    followed, changes = SoftenedEffects(), []
    for cycle, value in enumerate(rendered):
        softened = {} if value is None else {"stiffness": (200.0, value)}
        changes += followed.update(cycle / rate, {"wall": EffectDemand(np.zeros(3), 200.0, softened=softened)})
    return [(change.rendered, round(change.since, 2)) for change in changes], [change.text for change in changes]


def test_a_softening_is_told_as_it_begins_changes_and_ends():
    changes, texts = told([None] * 10 + [33.0] * 100 + [20.0] * 100 + [None] * 60)
    assert changes == [(33.0, 0.2), (20.0, 0.2), (200.0, 0.2)]
    assert texts[0] == '"wall": stiffness is 200 N/m, 33 are rendered'
    assert texts[2] == '"wall": stiffness is 200 N/m again, as desired'


def test_what_changes_from_cycle_to_cycle_is_told_once_a_second():
    changes, _ = told([70.0, 70.0, 70.0, 140.0, 140.0] * 50)
    assert 4 <= len(changes) <= 6
    assert {rendered for rendered, _ in changes} == {70.0, 140.0}
    assert told([33.0, None] * 50)[0] == [(33.0, 0.0)]


def test_the_share_is_that_of_the_softest_parameter():
    softened = {"stiffness": (200.0, 50.0), "friction.stiffness": (400.0, 50.0)}
    assert EffectDemand(np.zeros(3), softened=softened).share == 0.125
    assert EffectDemand(np.zeros(3)).share == 1.0
