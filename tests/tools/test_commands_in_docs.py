"""The commands that documents show are there: verbs, options and targets of the Makefile, in whichever file."""

import re
import shlex
from pathlib import Path

import pytest
from typer.main import get_command

from tensionlab.cli import app

ROOT = Path(__file__).parents[2]
MADE = {".venv", "build", "out", "generated"}
FOLDERS = [path for path in ROOT.iterdir() if path.is_dir() and path.name not in MADE and "cache" not in path.name]
FILES = sorted([*ROOT.glob("*.md"), *(path for folder in FOLDERS for path in folder.rglob("*.md"))])
FILES = [path for path in FILES if not MADE & set(path.relative_to(ROOT).parts)]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
CALL = re.compile(r"^(?:\.venv/bin/)?tensionlab (.+)$|`(?:\.venv/bin/)?tensionlab ([^`]+)`", re.MULTILINE)


def calls(text):
    """What stands behind `tensionlab`, in blocks of code and within lines."""
    joined = text.replace("\\\n", " ")  # a shell's continued lines
    return [" ".join((one or two).split()) for one, two in CALL.findall(joined)]


def wrong(words):
    """What of a command there is not; None if all is there."""
    command = get_command(app)
    rest = shlex.split(words, comments=True)
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        word, *rest = rest
        command = command.get_command(None, word)
        if command is None:
            return word
    there = {name for each in command.params for name in (*each.opts, *each.secondary_opts)} | {"--help"}
    return next((word for word in rest if word.startswith("--") and word.partition("=")[0] not in there), None)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_verbs_options_and_targets_are_there(path):
    text = path.read_text(encoding="utf-8")
    assert {call: wrong(call) for call in calls(text) if wrong(call)} == {}
    targets = re.findall(r"(?:^|`)make ([a-z-]+)", text, re.MULTILINE)
    assert {target for target in targets if not re.search(rf"^{target}:", MAKEFILE, re.MULTILINE)} == set()


def test_what_is_not_there_is_seen():
    assert sum(len(calls(path.read_text(encoding="utf-8"))) for path in FILES) > 30
    assert calls("`tensionlab module ping\n URL` x\n.venv/bin/tensionlab run RIG --log f\n") == [
        "module ping URL",
        "run RIG --log f",
    ]
    assert wrong("module pong URL") == "pong"
    assert wrong("run RIG --logs=f") == "--logs=f"
    assert wrong("run RIG --log f --help") is None
