"""The command line runs no code of the folder that it is called in, whatever the verb."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.distribution import install
from tests.helpers.verbs import every_verb

ROOT = Path(__file__).parents[2]
RIG = ROOT / "datasets" / "rigs" / "bartels2026-validation.toml"
POISONED = ("numpy", "random", "matplotlib", "viser", "yaml", "ecos", "mosek", "sitecustomize", "usercustomize")
ALSO_POISONED = ("json", "typing", "threading", "socket", "webbrowser", "pyarrow", "websockets", "filelock",
                 "serial")  # fmt: skip
"""Modules that Python itself takes from the folder with ``python -m``, before any code of tensionlab runs."""
PAD_INCHES = 17.0
HANGS_S = 600.0  # the verbs take 20 s on an idle machine

DRIVER = """
import io, json, os, signal, sys, threading
from tensionlab.__main__ import main  # as the console script has it

class Stdout(io.StringIO):
    # A verb that goes on until Ctrl-C gets one as soon as it says where it serves.
    endless = False
    def write(self, text):
        if self.endless and text.strip():
            self.endless = False
            threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
        return len(text)

sys.stdout, said = Stdout(), sys.stdout
statuses = {}
for name, words, endless in json.load(sys.stdin):
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv, sys.stdout.endless = ["tensionlab", *words], endless
    try:
        main()
    except SystemExit as left:
        statuses[name] = left.code or 0
import matplotlib
print(json.dumps({"statuses": statuses, "pad": matplotlib.rcParamsOrig["savefig.pad_inches"]}), file=said)
"""
RECIPES = {
    "run": f"run {RIG} --seconds 0.2 --log run.mcap --view",
    "compare": f"compare {RIG} --directions fibonacci:1 --plot c.png",
    "allocate": f"allocate {RIG} --wrench 0 0 1 --solver qp",
    "workspace": f"workspace {RIG} --box 0,0.1,0.3,0.3,0,0.1 --step 0.1 --metric wrench-closure --plot w.png",
    "bench": "bench --set edge --solvers closed-form,daqp --count 2 --quick",
    "scenario": "scenario materials --seconds 0.2 --view",
    "serve": f"serve {RIG} --seconds 0.2 --port 0 --view",
    "simulate": "simulate",
    "estop": "estop sim:",
    "module monitor": "module monitor sim: --seconds 0.1",
    "module ping": "module ping sim: --count 2",
    "module stop": "module stop sim:",
    "module discover": "module discover",
    "new": "new rig --out rig.toml",
    "view": "view cube-8 --no-browser",
    "rig show": "rig show rig.toml --plot r.png",
    "rig check": "rig check rig.toml",
    "rig export": "rig export rig.toml --out rig.xml",
    "log info": "log info run.mcap",
    "log plot": "log plot run.mcap --plot l.png",
    "log export": "log export run.mcap --out l.csv",
    "log view": "log view run.mcap --no-browser",
    "problems": "problems edge --count 6 --out edge.parquet",
}  # what makes a verb do its work; of all others, each required argument is a word
ENDLESS = {"simulate", "view", "log view"}


def commands():
    """Return each verb, its words, and whether it goes on until Ctrl-C; those of the recipes first."""
    required = {
        words: sum(each.required for each in verb.params if each.param_type_name == "argument")
        for words, verb in every_verb()
    }
    assert set(RECIPES) <= set(required)
    others = {name: " ".join([name, *["nothing"] * count]) for name, count in required.items()}
    return [(name, words.split(), name in ENDLESS) for name, words in (RECIPES | (others | RECIPES)).items()]


@pytest.fixture
def marks(tmp_path):
    """A folder in which what is loaded leaves a file of its name."""
    (tmp_path / "marks").mkdir()
    return tmp_path / "marks"


@pytest.fixture
def folder(tmp_path, marks):
    """A folder full of what Python, its libraries and git load from a working directory that they trust."""
    made = tmp_path / "folder"
    install(made, "evil", {"evil": "evil:Evil"}, {"evil": ""})
    poison = f"open({str(marks)!r} + '/' + __name__, 'w').close()\n"
    for name in ("evil", *POISONED):
        (made / f"{name}.py").write_text(poison)
    (made / "matplotlibrc").write_text(f"savefig.pad_inches: {PAD_INCHES}\n")
    if shutil.which("git"):
        subprocess.run(["git", "init", "-q"], cwd=made, check=True)
        (made / "monitor.sh").write_text(f"#!/bin/sh\ntouch {marks}/git\n")
        (made / "monitor.sh").chmod(0o700)
        for words in (["config", "core.fsmonitor", "./monitor.sh"], ["add", "evil.py"]):
            subprocess.run(["git", *words], cwd=made, check=True)
        for mark in marks.iterdir():
            mark.unlink()
    return made


def test_no_verb_loads_anything_from_the_folder_it_is_called_in(folder, marks, tmp_path):
    poison = (folder / "evil.py").read_text()
    for name in ALSO_POISONED:
        (folder / f"{name}.py").write_text(poison)
    (script := tmp_path / "tensionlab").write_text(DRIVER)
    (browser := tmp_path / "browser").write_text("#!/bin/sh\n")
    browser.chmod(0o700)
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, str(script)],
        input=json.dumps(commands()),
        cwd=folder,
        env=kept | {"BROWSER": str(browser)},
        capture_output=True,
        text=True,
        check=False,
        timeout=HANGS_S,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert sorted(each.name for each in marks.iterdir()) == []
    assert found["pad"] != PAD_INCHES, "matplotlibrc was read"
    assert {name for name in RECIPES if found["statuses"][name] not in (0, 1, 130)} == set(), done.stderr


def test_python_m_tensionlab_takes_the_folder_off_its_path_first(folder, marks):
    words = ["-m", "tensionlab", "bench", "--set", "edge", "--solvers", "daqp", "--count", "2", "--quick"]
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert sorted(each.name for each in marks.iterdir()) == []
    assert done.returncode == 0, done.stderr
