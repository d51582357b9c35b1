"""The ESP32's firmware for each motor shield, on simulated hardware with each."""

import sys

import pytest

from firmware.dangers import INCLUDES, OPTIONS
from tests.helpers.compiled import FIRMWARE, compile_program, run_program

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the fakes are for POSIX")
SHIELDS = (2, 3, 4)
OTHER_PADS = {3: "6 10 5 8 A0 A2", 4: "6 10 5 8 A0 A2 A3"}


@pytest.fixture(scope="module", params=SHIELDS)
def firmware(request, tmp_path_factory):
    """Version of a shield, and a program with the firmware for it."""
    # It compiles longer than it runs.
    options = (*OPTIONS, "-O0", *INCLUDES, f"-DTENSIONLAB_SHIELD={request.param}")
    return request.param, compile_program("shields", tmp_path_factory.mktemp("shields"), options=options)


@pytest.mark.parametrize("mounted", SHIELDS)
def test_it_pulls_what_it_is_told_with_its_own_shield_and_refuses_to_calibrate_with_another(firmware, mounted):
    version, program = firmware
    for seed in range(6 if version == mounted else 2):
        (*found,), (refused, tension, supply) = run_program(program, mounted, seed)
        if version != mounted:
            assert " ".join(found).startswith("align: currents do not fit"), seed
            assert float(tension) < 0.1
            continue
        assert (found, refused) == (["align:", "done"], "0"), seed
        assert float(tension) == pytest.approx(3.0, abs=0.15)  # dry friction and cogging take up to 0.13 N
        assert float(supply) == pytest.approx(1.0, abs=0.08)  # the converter's curve


@pytest.mark.parametrize("version", OTHER_PADS)
def test_the_pads_are_those_that_the_makers_page_suggests_for_one_shield(version):
    """See docs.simplefoc.com/pads_soldering_v3 and _v4."""
    text = (FIRMWARE / "esp32" / "boards" / f"shield_{version}.hpp").read_text(encoding="utf-8")
    pads = [line.rsplit(" ", 1)[1] for line in text.splitlines() if "// header pad" in line]
    assert " ".join(pads) == OTHER_PADS[version]
