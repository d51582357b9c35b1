"""Round trips as they are, and the rate of set-points that follows from them."""

import math

import pytest

from tensionlab.hardware.client import latency
from tensionlab.hardware.client.latency import RoundTrips, is_bluetooth, measure, safe_rates
from tensionlab.hardware.client.links import SerialPort
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.simulation.links import Conditions, FaultyLink, SimulatedLink
from tensionlab.hardware.simulation.simulated_module import STEP_S, SimulatedModule


def client(conditions, seed=1, start_us=0):
    module = SimulatedModule(start_us=start_us)
    module.advance(STEP_S)
    return ModuleClient("one", FaultyLink(SimulatedLink(module), conditions, seed=seed))


def test_trips_are_as_long_as_the_link_makes_them():
    with client(Conditions(latency=0.03, jitter=0.02)) as one:
        trips = measure(one, 200, lambda done: True)
    assert trips.lost == 0
    assert 0.060 <= min(trips.times) < 0.066
    assert trips.percentile(50) == pytest.approx(0.08, abs=0.003)
    assert trips.percentile(50) < trips.percentile(95) < trips.percentile(99) <= trips.percentile(100) < 0.102


def test_the_modules_clock_is_found_as_exactly_as_the_shortest_trip_allows():
    with client(Conditions(latency=0.01, jitter=0.005), start_us=5_000_000) as one:
        trips = measure(one, 50, lambda done: True)
    assert trips.offset_error == min(trips.times) / 2
    assert abs(trips.offset - 5.0) < trips.offset_error
    assert abs(trips.offset - 5.0) < 0.004


def test_what_does_not_come_back_is_lost_and_no_late_answer_is_taken_for_another():
    with client(Conditions(latency=0.01, drop=0.01), seed=4) as one:
        trips = measure(one, 100, lambda done: True)
    assert len(trips.times) + trips.lost == 100
    assert 10 < trips.lost < 50
    assert max(trips.times) < 0.03


def test_it_ends_where_it_is_told_to():
    with client(Conditions()) as one:
        assert len(measure(one, 100, lambda done: done < 7).times) == 7


def test_nothing_that_comes_back_is_no_rate():
    trips = RoundTrips((), 5, math.nan, math.nan)
    assert math.isnan(trips.percentile(50))
    assert trips.loss == 1.0
    assert safe_rates(trips, 0.25, bluetooth=False) is None


@pytest.mark.parametrize(
    ("trip", "lost", "ttl", "bluetooth", "expected"),
    [
        (0.1, 0, 0.25, True, (3 / 0.2, 100.0)),
        (0.1, 0, 0.25, False, (3 / 0.2, 1000.0)),
        (0.1, 25, 0.25, True, (10 / 0.2, 100.0)),  # of four, one is lost: 0.25**10 < 1e-6 < 0.25**9
        (0.1, 225, 0.25, True, None),  # 49 in 200 ms
        (0.45, 0, 0.25, True, None),  # 3 in 25 ms
        (0.45, 0, 0.25, False, (120.0, 1000.0)),
        (0.6, 0, 0.25, False, None),
    ],
)
def test_the_rule_of_the_safe_rate(trip, lost, ttl, bluetooth, expected):
    found = safe_rates(RoundTrips((trip,) * 75, lost, 0.0, 0.0), ttl, bluetooth=bluetooth)
    assert found == (None if expected is None else pytest.approx(expected))


def test_what_is_bluetooth():
    assert all(map(is_bluetooth, ["bt://AA:BB:CC:DD:EE:FF/1", "/dev/rfcomm0", "/dev/cu.tensionlab-1a2b3c4d"]))
    assert not any(map(is_bluetooth, ["COM5", "/dev/ttyUSB0", "socket://127.0.0.1:1", "sim:"]))


def test_what_is_bluetooth_on_windows(monkeypatch):
    hardware = {"COM3": "USB VID:PID=10C4:EA60 SER=1", "COM5": r"BTHENUM\{00001101-0000-1000-8000-00805F9B34FB}"}
    ports = [SerialPort(url, "", text, None) for url, text in hardware.items()]
    monkeypatch.setattr(latency, "serial_ports", lambda: ports)
    assert [is_bluetooth(url) for url in ("com5", "COM5", "COM3", "COM4")] == [True, True, False, False]
