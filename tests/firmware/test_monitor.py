"""What the firmware makes of its sensors: faults, how far a step may move anything, how warm the winding is."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tensionlab.hardware.protocol.codes import Fault

ROOT = Path(__file__).parents[2]
USUAL = {"elapsed": 250, "angle": 10.0, "speed": 0.0, "current": 0.7, "supply": 12.0, "ok": 1, "commanded": 0.7}
RADIUS, SPEED_LIMIT, PEAK = 0.0195, 3.0, 2.2  # as a module has them at first


def built(name, folder):
    """Compile a program of `tests/data` with the firmware's headers."""
    compiler = shutil.which("c++")
    strict = ["-std=c++17", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", f"-I{ROOT / 'firmware'}"]
    source = ROOT / "tests" / "data" / f"{name}.cpp"
    subprocess.run([compiler, *strict, str(source), "-o", str(folder / name)], check=True)
    return str(folder / name)


@pytest.fixture(scope="module")
def monitor(tmp_path_factory):
    """Return a function: faults, seconds and length after each of some samples, given by what is unusual."""
    program = built("monitor", tmp_path_factory.mktemp("monitor"))

    def watch(*samples):
        lines = [" ".join(str((USUAL | sample)[name]) for name in USUAL) for sample in ({"elapsed": 0}, *samples)]
        out = subprocess.run([program], input="\n".join(lines), check=True, capture_output=True, text=True).stdout
        told = [line.split() for line in out.splitlines()]
        return [(Fault(int(word)), float(seconds), float(length)) for word, seconds, length in told][1:]

    return watch


@pytest.mark.parametrize(
    ("unusual", "enough", "fault"),
    [
        ({"ok": 0}, 4, Fault.ENCODER),
        ({"angle": "nan"}, 4, Fault.ENCODER),
        ({"speed": "inf"}, 4, Fault.ENCODER),
        ({"speed": -1.01 * 2.0 * SPEED_LIMIT / RADIUS}, 4, Fault.SPEED),
        ({"current": "nan"}, 4, Fault.CURRENT),
        ({"current": 1.51 * PEAK}, 4, Fault.CURRENT),
        ({"current": -1.51 * PEAK}, 4, Fault.CURRENT),
        ({"supply": 7.9}, 40, Fault.SUPPLY),
        ({"supply": 16.1}, 40, Fault.SUPPLY),
        ({"supply": "nan"}, 40, Fault.SUPPLY),
        ({"current": 0.34}, 200, Fault.CURRENT),  # less than half of what was commanded: a wire is off
    ],
)
def test_what_is_wrong_for_a_while_is_a_fault_until_it_has_been_right_for_ten_times_as_long(
    monitor, unusual, enough, fault
):
    told = [found for found, _, _ in monitor(*[unusual] * enough, *[{}] * (10 * enough))]
    right = 10 * enough
    assert told == [Fault(0)] * (enough - 1) + [fault] * right + [Fault(0)]


@pytest.mark.parametrize(
    "usual",
    [
        {"speed": 5.0 * SPEED_LIMIT / RADIUS},  # a hand pulls the cable out
        {"speed": -0.99 * 2.0 * SPEED_LIMIT / RADIUS, "current": 0.0},  # the supply does not suffice
        {"current": 1.49 * PEAK},
        {"current": -1.49 * PEAK, "commanded": 0.0},
        {"current": 0.36},
        {"current": 0.0, "commanded": 0.1},
        {"supply": 8.0},
        {"supply": 16.0},
    ],
)
def test_what_may_last_is_no_fault(monitor, usual):
    assert {found for found, _, _ in monitor(*[usual] * 1000)} == {Fault(0)}


def test_what_the_encoder_cannot_have_seen_moves_nothing(monitor):
    told = monitor(
        {"angle": 20.0}, {"angle": "nan"}, {"angle": 30.0, "speed": "inf"}, {"angle": 40.0, "ok": 0}, {}
    )
    assert [length for _, _, length in told] == pytest.approx([20.0 * RADIUS] * 4 + [10.0 * RADIUS])


@pytest.mark.parametrize(
    ("elapsed", "fault", "seconds"),
    [
        (250, 0, 250e-6),
        (5000, 0, 5e-3),
        (5001, Fault.LOOP, 5e-3),
        (10**9, Fault.LOOP, 5e-3),
        (-1, Fault.LOOP, 0.0),
    ],
)
def test_a_step_that_comes_too_late_or_before_the_last_one_is_a_fault_and_moves_little(
    monitor, elapsed, fault, seconds
):
    told = monitor({}, {"elapsed": elapsed}, {})
    assert [found for found, _, _ in told] == [Fault(0), Fault(fault), Fault(0)]
    assert told[1][1] == pytest.approx(seconds)


def test_what_is_left_of_a_windings_budget_may_be_spent_within_a_tenth_of_its_time(tmp_path):
    """It stands 1 A for ever, 2.2 A at most, and warms with 20 s: at 2 A its budget is spent after 5.8 s."""
    command = [built("thermal", tmp_path), "2.0", "1200"]
    out = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    stands, spent = np.array([line.split() for line in out.splitlines()], dtype=float).T
    warmth = 4.0 * (1.0 - (1.0 - 0.01 / 20.0) ** np.arange(1, 1201))
    np.testing.assert_allclose(spent, np.minimum(warmth, 1.0), atol=1e-4)
    left = np.maximum(1.0 - warmth, 0.0)
    np.testing.assert_allclose(stands, np.minimum(np.sqrt(1.0 + 10.0 * left), PEAK), atol=1e-3)
    assert stands[0] == pytest.approx(PEAK)
    assert stands[-1] == 1.0
