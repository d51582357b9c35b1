"""`tensionlab new`: each file passes its own check as it is written."""

import re
import shlex
import tomllib

import pytest

import tensionlab as tl
from tensionlab.cli.catalogue import TEMPLATE_KINDS, TEMPLATES
from tensionlab.hardware import load_program
from tensionlab.scenarios import check_needs, load_scenario
from tensionlab.validation.rig_check import check_rig
from tensionlab.workspace.layout.task import load_task


def read(kind, path):
    """A file of some kind."""
    match kind:
        case "rig":
            return tl.load_rig(path)
        case "space":
            return load_task(path)
        case "scenario":
            return load_scenario(path)
        case "program":
            return load_program(path, tl.load_rig("seven-modules"))


CHECKS = {
    "rig": lambda rig: all(each.passed for each in check_rig(rig)),
    "space": lambda task: task.run().best.score > 0.0,
    "scenario": lambda scenario: all(each.passed for each in check_needs(scenario)),
    "program": lambda program: program.seconds == 2.0,
}


@pytest.mark.parametrize("kind", TEMPLATE_KINDS)
def test_what_is_written_can_be_used_as_it_is(run, tmp_path, kind):
    path = tmp_path / f"first-{kind}.toml"
    code, out, err = run("new", kind, "--out", path)
    assert (code, err) == (0, "")
    assert out.startswith(f"{kind}: {path}; ")
    found = read(kind, path)
    assert found.name == path.stem
    assert CHECKS[kind](found)
    text = path.read_text()
    assert f"my-{kind}" not in text
    assert text.replace(str(path), f"my-{kind}.toml").replace(path.stem, f"my-{kind}") == run("new", kind)[1]


@pytest.mark.parametrize("kind", TEMPLATE_KINDS)
def test_keys_that_are_commented_out_are_read_as_well(tmp_path, kind):
    text = (TEMPLATES / f"{kind}.toml").read_text()
    whole = re.sub(r"^# (?=\w+ = |\[)", "", text, flags=re.MULTILINE)
    assert whole != text
    (tmp_path / "whole.toml").write_text(whole)
    assert tomllib.loads(whole) != tomllib.loads(text)
    read(kind, tmp_path / "whole.toml")


@pytest.mark.parametrize("kind", TEMPLATE_KINDS)
def test_the_commands_in_it_are_commands(kind):
    """Their words and options are known to the program."""
    import typer

    from tensionlab.cli import app

    lines = (TEMPLATES / f"{kind}.toml").read_text().splitlines()
    commands = [line.split(": ", 1)[1].split("  (")[0] for line in lines if "tensionlab " in line]
    assert commands
    for command in commands:
        group = typer.main.get_command(app)
        words = shlex.split(command)[1:]
        while hasattr(group, "get_command"):
            group = group.get_command(None, words.pop(0))
        options = {name for each in group.params for name in each.opts}
        assert {word for word in words if word.startswith("--")} <= options, command
