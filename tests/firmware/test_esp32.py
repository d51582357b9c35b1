"""The ESP32's layer: its syntax against stubs, and what of it needs no ESP32, run."""

import re
import subprocess
from configparser import ConfigParser
from functools import cache, partial

import pytest

from tests.helpers.compiled import FIRMWARE, ROOT, compile_program, run_program


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Return a function that compiles a program once, runs it, and returns the numbers of each line."""
    program = cache(partial(compile_program, folder=tmp_path_factory.mktemp("esp32")))
    return lambda name, *words: [tuple(map(float, row)) for row in run_program(program(name), *words)]


def test_it_fits_the_libraries_as_far_as_stubs_can_tell():
    found = subprocess.run([str(FIRMWARE / "esp32" / "check.sh")], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stderr) == (0, "")


def test_the_workflow_builds_every_environment_with_the_documented_tool():
    settings = ConfigParser(interpolation=None)
    settings.read(FIRMWARE / "platformio.ini")
    environments = [name.removeprefix("env:") for name in settings.sections() if name.startswith("env:")]
    workflow = (ROOT / ".github" / "workflows" / "firmware.yml").read_text(encoding="utf-8")
    assert f"environment: [{', '.join(environments)}]\n" in workflow
    (tool,) = re.findall(r"pip install \"(pioarduino==[\w.]+)\"", workflow)
    assert f"pip install {tool}\n" in (FIRMWARE / "README.md").read_text(encoding="utf-8")


def test_two_threads_pass_bytes_through_the_queue(build):
    [(sent, came, wrong, most, rest, room)] = build("byte_queue")
    assert (came, wrong, rest, room) == (sent, 0, 0, 64)
    assert sent > 64  # once around at least
    assert 1 < most <= 64


def test_the_encoder_counts_turns_either_way(build):
    angles = [100, 8000, 15000, 16383, 3, 5000, 3, 16380, 9000, 2000, 15000]
    rows = build("as5048a", 100, 100, 100, *angles)
    assert [row[1] for row in rows[3:]] == [100, 8000, 15000, 16383, 16387, 21384, 16387, 16380, 9000, 2000, -1384]
    assert all(row[0] for row in rows[3:])
    assert rows[-1][2:] == (3000, 128, 0)  # magnitude, gain in the middle, no errors


def test_an_angle_is_not_trusted_before_the_chip_said_that_it_is_ready(build):
    first, *_ = build("as5048a", 100, 100, 100)
    assert not first[0]
    assert not any(row[0] for row in build("as5048a", "unready", 100, 100, 100, 100))


@pytest.mark.parametrize("fault", ["flip", "garble", "stuck-low", "stuck-high"])
def test_a_frame_that_breaks_is_noticed_and_the_next_ones_are_good_again(build, fault):
    rows = build("as5048a", *[5000] * 4, *[fault] * 4, *[6000] * 8)
    ok = [row[0] for row in rows]
    assert ok[3]
    assert not all(ok[4:8])
    assert all(ok[-3:])
    assert rows[-1][1] == 6000
    if fault != "stuck-low":  # whose frames are good ones that say that the chip is not ready
        assert rows[-1][4] > 0
        assert not ok[4]


def test_a_single_flipped_bit_costs_two_readings_at_most(build):
    ok = [row[0] for row in build("as5048a", *[5000] * 4, "garble", *[5001] * 5)]
    assert ok[4:].count(False) <= 2
    assert all(ok[-3:])


@pytest.mark.parametrize("field", ["weak", "strong"])
def test_a_magnet_that_is_too_near_or_too_far_is_no_angle(build, field):
    ok = [row[0] for row in build("as5048a", *[5000] * 4, field, *[5000] * 4, "found", *[5000] * 4)]
    assert ok[3]
    assert not any(ok[7:9])
    assert ok[-1]
