"""The core on emulated processors: it sends the same bytes as here, and takes no more than its budget."""

import functools
import json
import shutil

import pytest

from firmware import check, emulate
from firmware.emulation.processors import PROCESSORS, missing
from tensionlab.hardware.protocol.codes import BrakeState, Code, Fault, Limit, State
from tensionlab.hardware.protocol.messages import MESSAGES
from tests.helpers.compiled import skip_without

CORE = check.FIRMWARE / "core"
FIGURES = json.loads(emulate.FIGURES.read_text(encoding="utf-8"))["core"]


def bits(numbers):
    return functools.reduce(int.__or__, (1 << number for number in numbers))


def test_the_stream_reaches_everything_that_a_module_can_say():
    found = emulate.measure_core("host")
    assert found["wraps"] == 1
    assert found["states"] == bits(State)
    assert found["limits"] == bits(Limit)
    assert found["faults"] == sum(Fault)
    assert found["brakes"] == bits(BrakeState)
    assert found["codes"] == bits(set(Code) - {Code.STALE})  # which is never acknowledged
    assert found["messages"] == bits(number & 31 for number in MESSAGES if number >= 0x80)
    assert all(
        found[f"{message.type.name.lower()}_count"] > 10 for number, message in MESSAGES.items() if number < 0x80
    )


@pytest.mark.slow
def test_processors_send_the_bytes_of_this_computer_within_the_budget():
    """Else, if the core must take more: `python firmware/emulate.py core --write`, and `make generated`."""
    found = {name: emulate.measure_core(name) for name in PROCESSORS if not missing(name)}
    here = found.pop("host")
    for name, there in found.items():
        assert there["hash"] == here["hash"], name
        assert emulate.over_budget(name, there) == []
    skip_without(*PROCESSORS)


def changed_core(folder, name, line, change):
    """Copy the core with one line changed; return its sources."""
    shutil.copytree(CORE, folder / "core")
    source = folder / "core" / name
    text = source.read_text(encoding="utf-8")
    assert text.count(line) == 1
    source.write_text(text.replace(line, change), encoding="utf-8")
    return sorted((folder / "core").glob("*.cpp"))


def test_a_core_that_takes_longer_exceeds_its_budget(tmp_path):
    skip_without("cortex-m4f")
    line = "  supervise(sensors);\n"
    core = changed_core(tmp_path, "module.cpp", line, 2 * line)
    found = emulate.measure_core("cortex-m4f", 20_000, core)
    assert any(excess.startswith("step_median is ") for excess in emulate.over_budget("cortex-m4f", found))


def test_the_core_asks_for_no_library_and_fits_its_budget(tmp_path):
    """Else, if the core must be larger: `python firmware/check.py arm esp32 --write`, and `make generated`."""
    skip_without("cortex-m4f")
    assert check.over_budget("arm", check.arm(tmp_path)) == []


def test_the_committed_figures_are_of_equal_bytes():
    assert FIGURES["steps"] >= 100_000
    assert FIGURES["cortex-m4f"]["hash"] == FIGURES["xtensa"]["hash"] == FIGURES["host"]["hash"]
