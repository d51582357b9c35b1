"""A module that allocates for all: its links carry what it chose, and every processor chooses the same."""

from __future__ import annotations

import json

import pytest

from firmware import emulate
from firmware.emulation.processors import PROCESSORS, missing
from tests.helpers.compiled import ROOT, STRICT, compile_program, run_program, skip_without

RUNNING = 2  # State::running


def test_modules_pull_what_the_coordinator_chose(tmp_path):
    core = sorted((ROOT / "firmware" / "core").glob("*.cpp"))
    options = (*STRICT, "-O0", f"-I{ROOT}", f"-I{ROOT / 'include'}")  # it compiles longer than it runs
    rows = run_program(compile_program("coordinator", tmp_path, *core, options=options))
    assert len(rows) == 24
    for _, state, chosen, tension in rows:
        assert int(state) == RUNNING
        assert float(tension) == pytest.approx(float(chosen), rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "policy", "limit"), [((3, 8), "force", 100), ((6, 8), "tension", 100), ((3, 4), "direction", 10)]
)
def test_emulated_processors_answer_as_this_computer_does(shape, policy, limit):
    processors = [name for name in PROCESSORS if not missing(name)]
    found = {name: emulate.measure_allocator(name, shape, 150, limit, policy, "-O1") for name in processors}
    here = found.pop("host")
    for there in found.values():
        assert there["hash"] == here["hash"]
        assert there["outside"] == 0
        assert there["iterations"] <= 2 * limit + 4 * shape[0] + 4
        assert 0 < there["stack"] < 4096
        assert there["median"] <= there["p999"] <= there["worst"]
    skip_without(*PROCESSORS)


def test_the_committed_figures_are_of_equal_answers_inside_the_limits():
    figures = json.loads(emulate.FIGURES.read_text(encoding="utf-8"))["allocator"]
    assert figures["problems"] >= 100_000
    for shape, here in figures["host"].items():
        for processor in ("cortex-m4f", "xtensa"):
            there = figures[processor][shape]
            assert (there["hash"], there["outside"], there["iterations"]) == (
                here["hash"], 0, here["iterations"]
            )  # fmt: skip
