"""What a link does to bytes: later, in order, fewer, and with flipped bits."""

import random

import pytest

from tensionlab.errors import HardwareError
from tensionlab.hardware.simulation.channel import Channel, Conditions


def channel(seed=1, **conditions):
    return Channel(Conditions(**conditions), random.Random(seed))


def test_a_perfect_link_gives_at_once_what_it_got():
    link = channel()
    link.put(b"ab", 1.0)
    link.put(None, 1.0)
    assert link.due == 1.0
    assert link.take(1.0) == [b"ab", None]
    assert link.take(9.0) == []
    assert link.due == float("inf")


def test_bytes_take_the_latency_and_up_to_the_jitter_and_never_overtake():
    link, delays, arrived = channel(latency=0.03, jitter=0.02), [], []
    for index in range(1000):
        sent = 0.1 * index
        link.put(bytes([index % 256]), sent)
        delays.append(link.due - sent)
        assert link.take(sent + 0.0299) == []
        arrived += link.take(sent + 0.0501)
    assert b"".join(arrived) == bytes(index % 256 for index in range(1000))
    assert min(delays) < 0.0305
    assert max(delays) > 0.0495
    for index in range(1000):  # all at once: jitter may not change their order
        link.put(bytes([index % 256]), 200.0)
    assert b"".join(link.take(201.0)) == b"".join(arrived)


def test_the_share_of_the_bytes_that_was_asked_for_is_lost():
    link = channel(drop=0.1)
    link.put(bytes(100_000), 0.0)
    [content] = link.take(0.0)
    assert len(content) == pytest.approx(90_000, abs=500)


def test_the_share_of_the_bytes_that_was_asked_for_has_one_bit_flipped():
    link = channel(corrupt=0.02)
    link.put(bytes(100_000), 0.0)
    [content] = link.take(0.0)
    damaged = [byte for byte in content if byte]
    assert len(content) == 100_000
    assert len(damaged) == pytest.approx(2_000, abs=200)
    assert all(byte.bit_count() == 1 for byte in damaged)
    assert len(set(damaged)) == 8


def test_the_same_seed_has_the_same_accidents():
    first, second, other = (channel(seed, drop=0.3) for seed in (1, 1, 2))
    for link in (first, second, other):
        link.put(bytes(range(256)), 0.0)
    found = first.take(0.0)
    assert found == second.take(0.0)
    assert found != other.take(0.0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"latency": -1e-3}, "latency is from 0 to 60 s; got -0.001"),
        ({"jitter": float("nan")}, "jitter"),
        ({"drop": 1.5}, "drop is a share, from 0 to 1; got 1.5"),
        ({"corrupt": -0.1}, "corrupt"),
    ],
)
def test_conditions_that_cannot_be_are_refused(wrong, message):
    with pytest.raises(HardwareError, match=message):
        Conditions(**wrong)
