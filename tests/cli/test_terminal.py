"""What the command line looks like in terminals: whole words, names and quantities, and a legend that fits."""

import re
import sys

import pytest

from tensionlab.cli import VERBS
from tensionlab.cli.common import output
from tensionlab.model.files import save_rig
from tensionlab.support.table import Table
from tests.helpers.verbs import every_verb
from tests.model.test_spherical import RIG

SHOWN = [
    "solvers",
    "datasets",
    "scenario list",
    "rig show cogiro",
    "rig check seven-modules",
    "allocate ipanema-2 --wrench 100 0 900 0 0 0",
    "workspace kntu-planar --step 0.5",
]  # what prints the same each time
UNITS = r"(N|N·m|m|kg|s|ms|Hz|%|°|rad|deg)"


@pytest.fixture
def terminal(run, monkeypatch):
    """Run a command in a terminal of some columns: exit status, and stdout without its colours."""

    def call(columns, *words):
        monkeypatch.setenv("COLUMNS", str(columns))
        for stream in (sys.stdout, sys.stderr):
            monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
        status, out, err = run(*words)
        return status, re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", out), err

    return call


@pytest.mark.parametrize("words", [*SHOWN, "-h", *(f"{verb} -h" for verb in {**VERBS, **dict(every_verb())})])
def test_words_and_quantities_are_not_broken(terminal, words):
    columns = 64 if "-h" in words else 80
    narrow, wide = (terminal(size, *words.split())[1].replace("─", "") for size in (columns, 120))
    assert max(map(len, narrow.splitlines())) <= columns
    assert set(narrow.partition("Wider terminals")[0].split()) <= set(wide.split())
    assert not re.findall(rf"(?<![-\w.])\d[\d.]*\n\s*{UNITS}(?![\w.])", narrow)


def test_names_are_not_broken_where_they_have_spaces():
    rows = [[True, "full draw: brakes", "text of many words " * 9], [False, "string", "more text " * 9]]
    lines = Table(["", "effect", "finding"], rows).to_text(60).splitlines()
    assert sum("full draw: brakes  text" in line for line in lines) == 1


def test_the_legend_explains_what_is_shown(terminal):
    words = ("compare", "bartels2026-validation-0.3m", "--solvers", "newton,closed-form")
    (_, narrow, _), (_, wide, _) = terminal(80, *words), terminal(120, *words)
    explained = re.findall(r"^(\S+): ", narrow, re.MULTILINE)
    assert explained == ["exact", "near", "unproven", "error", "angle", "call", "batch"]
    assert {"fail", "t²", "gap"} == set(re.findall(r"^(\S+): ", wide, re.MULTILINE)) - set(explained)
    assert "any: " in terminal(80, "compare", "cube-8", "--solvers", "newton")[1]


def test_help_has_four_panels(terminal):
    out = terminal(80, "-h")[1]
    assert re.findall(r"^(\w+):$", out, re.MULTILINE) == ["Options", "Try", "Design", "Run", "Data"]


def test_a_message_has_its_own_line_beside_a_bar_of_progress(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(output, "BAR_AFTER_S", -1.0)
    with output.progress("Working") as report:
        report(0.1)
        output.print_message("a message")
        report(0.5)
    (line,) = (each for each in capsys.readouterr().err.split("\n") if "message" in each)
    assert re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", line.rpartition("\r")[2]) == "a message"


def test_quick_work_has_no_bar(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with output.progress("Working") as report:
        report(0.5)
    assert capsys.readouterr().err == ""


def test_torques_of_a_spherical_rig_are_in_newton_metres(run, tmp_path):
    save_rig(RIG, tmp_path / "wrist.toml")
    out = run("compare", tmp_path / "wrist.toml", "--solvers", "newton", "--magnitude", "0.1")[1]
    assert "182 torques of 0.1 N·m" in out
    assert "(N·m)" in out
    assert "error" in (told := run("allocate", tmp_path / "wrist.toml", "--wrench", "0 0 0")[1])
    assert re.search(r"^error \S+ N·m, exact", told, re.MULTILINE)
