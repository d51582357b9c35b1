"""Dangers, played with the ESP32's own code on simulated hardware: what the module does, and how soon."""

import json
import sys

import pytest

from firmware import dangers
from tests.helpers.defects import compile_programs
from tests.helpers.shared import make_once
from tests.stress import cases

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the fakes are for POSIX")
SEEDS = max(cases(5), 2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with the firmware's objects, and the program of them."""
    return make_once(tmp_path_factory, "dangers", compile_programs)


@pytest.fixture(scope="module")
def objects(folder):
    return sorted(folder.glob("*.o"))


@pytest.fixture(scope="module")
def played(folder):
    return dangers.play(folder / "dangers", SEEDS)


def test_the_module_does_what_it_must_in_every_danger(played):
    assert {danger.danger: danger.wrong for danger in played if danger.right < SEEDS} == {}


def test_the_committed_figures_are_of_these_dangers_and_no_smaller(played):
    """Else: `python firmware/dangers.py --write`, and `make generated`."""
    committed = json.loads(dangers.FIGURES.read_text(encoding="utf-8"))
    assert committed["seeds"] == dangers.SEEDS
    listed = [(found["danger"], found["must_happen"], found["right"]) for found in committed["dangers"]]
    assert listed == [(danger.danger, danger.must_happen, dangers.SEEDS) for danger in played]
    for danger, found in zip(played, committed["dangers"], strict=True):
        # Another compiler rounds otherwise.
        assert danger.noticed_s <= max(1.1 * found["noticed_s"], 0.0) + 1e-3, danger
        assert danger.tension_n <= 1.1 * found["tension_n"] + 0.05, danger


@pytest.mark.parametrize(
    ("line", "mutated", "danger"),
    [
        ("renewed_us_) > ttl_us_", "renewed_us_) > 100 * ttl_us_", "The radio is lost"),
        ("if (faults != 0) {", "if ((faults & ~kFaultSpeed) != 0) {", "The cable is cut at 3 N"),
    ],
)  # fmt: skip
def test_a_firmware_that_overlooks_a_danger_fails_its_row(objects, played, tmp_path, line, mutated, danger):
    core = dangers.FIRMWARE / "core" / "module.cpp"
    source = tmp_path / core.name
    text = core.read_text(encoding="utf-8")
    assert text.count(line) == 1
    source.write_text(text.replace(line, mutated), encoding="utf-8")
    (changed,) = dangers.compile_sources(tmp_path, source)
    program = dangers.link([changed, *(one for one in objects if one.name != changed.name)], tmp_path / "dangers")
    row = [found.danger for found in played].index(danger)
    (found,) = dangers.play(program, 2, row=row)
    assert found.right == 0
    assert found.wrong
