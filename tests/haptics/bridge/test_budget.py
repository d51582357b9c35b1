"""What a client may cost, by a clock of the test's."""

import pytest

from tensionlab.haptics.bridge.budget import BYTES_AT_ONCE, BYTES_PER_S, Budget


def refused(size, rate, work=0.0, seconds=10.0):
    """Share of messages that are refused, of so many bytes, at a rate, that take so long to read; and why."""
    budget, reasons = Budget(), []
    for number in range(int(rate * seconds)):
        why = budget.refuses(size, number / rate)
        reasons.append(why)
        if not why:
            budget.worked(work, number / rate)
    return sum(map(bool, reasons)) / len(reasons), reasons[-1]


def test_what_a_game_sends_is_never_too_much():
    assert refused(5_000, 120.0, 1e-3) == (0.0, "")


@pytest.mark.parametrize(
    ("size", "rate", "work", "said"),
    [
        (100, 1000.0, 0.0, "a flood: at most 500 messages a second"),
        (60_000, 450.0, 0.0, "too many bytes: at most 1000 kB a second"),
        (100, 100.0, 0.01, "too much to read: at most 20 % of a processor's time"),
    ],
)
def test_too_much_is_refused_with_the_reason(size, rate, work, said):
    share, why = refused(size, rate, work)
    assert share > 0.3
    assert why in (said, "")
    assert said in {refused(size, rate, work, seconds)[1] for seconds in (9.7, 9.8, 9.9, 10.0)}


def test_a_pause_is_enough_to_go_on():
    budget = Budget()
    while not budget.refuses(60_000, 0.0):
        pass
    for _ in range(1000):
        budget.refuses(60_000, 0.0)
    assert budget.refuses(100, 0.1)
    assert not budget.refuses(100, 2.0 * BYTES_AT_ONCE / BYTES_PER_S)
