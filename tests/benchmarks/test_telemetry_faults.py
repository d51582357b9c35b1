"""Faults that no module announces are noticed and named; `make faults` plays a thousand such runs."""

import pytest

from benchmarks.telemetry_faults import KINDS, Case, campaign, play


@pytest.mark.parametrize("kind", KINDS)
def test_each_is_noticed_in_time_and_the_module_is_named(kind):
    seed = list(KINDS).index(kind)
    assert play(Case(seed, kind, published_link=seed % 2 == 0)).wrong == ""


@pytest.mark.parametrize("published_link", [False, True])
def test_where_nothing_is_wrong_nothing_is_noticed(published_link):
    assert play(Case(7, None, published_link)).wrong == ""


def test_a_campaign_has_as_many_runs_without_a_fault():
    outcomes = list(campaign(1, seed=3))
    assert [each.case.kind for each in outcomes] == ["frozen", None]
    assert [each.wrong for each in outcomes] == ["", ""]
