import json
import os
import shutil
import signal

import pytest

import tensionlab as tl
from tensionlab.errors import LogError
from tensionlab.model.directions import grid18
from tensionlab.model.layouts import ring_plus_top
from tensionlab.validation.protocol import Protocol
from tensionlab.validation.session import JOURNAL_FILE, ValidationPlan, validate

RIG = ring_plus_top(1.0)


def plan(**changes):
    chosen = {"solver": "newton", "preset": "paper-like", "seed": 3} | changes
    return ValidationPlan(RIG, protocol=Protocol(hold=0.35, directions=grid18()[::15]), **chosen)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return the folder of a complete validation, and what was measured."""
    folder = tmp_path_factory.mktemp("validation") / "whole"
    return folder, validate(plan(), folder)[1]


@pytest.fixture
def found(tmp_path, whole):
    """Copy it to the test's own folder, and return what was measured."""
    shutil.copytree(whole[0], tmp_path, dirs_exist_ok=True)
    return whole[1]


def interrupted_after(count, total):
    """A progress that presses Ctrl-C."""

    def progress(share):
        if round(share * total) == count:
            os.kill(os.getpid(), signal.SIGINT)

    return progress


def test_interrupted_and_resumed_equals_uninterrupted(tmp_path, whole):
    total = len(plan().protocol.forces)
    folder, uninterrupted = whole
    assert len(uninterrupted) == total
    for count in (2, 9):
        _, part = validate(plan(), tmp_path / "parts", progress=interrupted_after(count, total))
        assert len(part) == count
    with (tmp_path / "parts" / JOURNAL_FILE).open("a") as file:
        file.write('{"number": 9, "dema')  # as a process leaves it that is killed
    _, parts = validate(plan(), tmp_path / "parts")
    assert parts == uninterrupted
    assert (tmp_path / "parts" / JOURNAL_FILE).read_text() == (folder / JOURNAL_FILE).read_text()


def test_what_is_complete_is_not_measured_again(tmp_path, found):
    _, again = validate(plan(), tmp_path, progress=lambda share: pytest.fail("measured again"))
    assert again == found


@pytest.mark.usefixtures("found")
def test_another_validation_is_not_continued(tmp_path):
    with pytest.raises(LogError, match="of a validation with other seed;"):
        validate(plan(seed=4), tmp_path)
    with pytest.raises(LogError, match="other solver"):
        validate(plan(solver="dykstra"), tmp_path)


@pytest.mark.usefixtures("found")
def test_a_damaged_journal_is_named_by_its_line(tmp_path):
    file = tmp_path / JOURNAL_FILE
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:3], *lines[4:]]) + "\n")
    with pytest.raises(LogError, match="line 4: damaged"):
        validate(plan(), tmp_path)
    first = json.loads(lines[1])
    first["surprise"] = 1
    file.write_text("\n".join([lines[0], json.dumps(first)]) + "\n")
    with pytest.raises(LogError, match=r"line 2: .*surprise"):
        validate(plan(), tmp_path)


@pytest.mark.usefixtures("found")
def test_the_journal_has_the_rig_itself(tmp_path):
    head = json.loads((tmp_path / JOURNAL_FILE).read_text().splitlines()[0])
    (tmp_path / "rig.toml").write_text(head["rig"])
    assert tl.load_rig(tmp_path / "rig.toml") == RIG
    assert head["simulated"] is True
