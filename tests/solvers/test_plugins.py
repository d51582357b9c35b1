"""Solvers of other distributions: loaded when named, never before, and harmless when broken."""

import json
import re
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest

import tensionlab as tl
from tensionlab.cli import main
from tensionlab.errors import PluginError, UnknownSolver
from tensionlab.solvers import every_solver, make, offered_plugins, select_solvers
from tests.helpers.distribution import install

RIG = Path(__file__).parents[2] / "datasets" / "rigs" / "bartels2026-validation.toml"
GOOD = """
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tensionlab.solvers.base import Answer


@dataclass(frozen=True)
class Fixed:
    \"\"\"What if every cable pulls alike?

    Source: a fable.
    \"\"\"

    newtons: float = 2.0

    objective: ClassVar[str] = "nothing: all tensions alike"
    policies: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self):
        if self.newtons < 0:
            raise ValueError("cables cannot push")

    def solve(self, problem):
        size, m = problem.lower.shape
        return Answer(tensions=np.full((size, m), self.newtons), iterations=np.zeros(size, dtype=int))
"""
NUMBER = count()


@pytest.fixture
def offer(tmp_path, monkeypatch):
    """Offer a solver: a module of this text, the entry point ``name = module:target``."""

    def call(name, text=GOOD, target="Fixed", distribution="fable-solvers"):
        module = f"fable_{next(NUMBER)}"  # modules stay loaded: each has a name of its own
        folder = tmp_path / module
        install(folder, distribution, {name: f"{module}:{target}"}, {module: text})
        monkeypatch.syspath_prepend(folder)

    return call


def test_no_distribution_offers_a_solver_here():
    assert offered_plugins() == {}


def test_a_solver_of_another_distribution_is_one_like_any(offer):
    offer("fixed")
    found = tl.allocate([[1.0, -1.0]], [0.0], (1.0, 5.0), solver="fixed")
    assert found.status == tl.Status.EXACT
    assert found.tensions.tolist() == [2.0, 2.0]
    assert make("fixed:3.5").newtons == 3.5
    assert every_solver()["fixed"]
    assert "fixed" in {run.name for run in select_solvers()[0]}
    assert select_solvers(["fixed"]) == ([("fixed", None, make("fixed"))], {})
    assert "fixed" not in tl.SOLVERS


def test_variants_are_checked_and_unknown_names_hinted_at(offer):
    offer("fixed")
    for name, message in {"fixed:much": "'fixed:much', 'much' is no value for fixed's newtons",
                          "fixt": "did you mean 'fixed'", "xyz": "newton, .*fixed"}.items():  # fmt: skip
        with pytest.raises(UnknownSolver, match=message):
            make(name)
    with pytest.raises(ValueError, match="cannot push"):
        make("fixed:-1")


def test_built_in_solvers_keep_their_names(offer, capsys):
    offer("newton")
    assert type(make("newton")) is tl.solvers.Newton
    assert every_solver()["newton"]
    with pytest.raises(SystemExit):
        main(["solvers"])
    out = capsys.readouterr().out
    assert "fable-solvers 1.0 offers a solver 'newton'" in out


BROKEN = {
    "import": ("import nowhere_to_be_found", "Fixed", "ModuleNotFoundError: .*nowhere_to_be_found"),
    "attribute": (GOOD, "Broken", "AttributeError: .*Broken"),
    "function": ("def Fixed(): pass", "Fixed", "lacks objective, policies, solve"),
    "plain class": (GOOD.replace("@dataclass(frozen=True)\n", ""), "Fixed", "no dataclass|AttributeError"),
    "policies": (GOOD.replace("= ()", '= ("closest",)'), "Fixed", "policy 'closest'; there are force"),
    "no default": (GOOD.replace(": float = 2.0", ": float"), "Fixed", "TypeError: .*newtons"),
    "bad default": (GOOD.replace("= 2.0", "= -2.0"), "Fixed", "cannot push"),
}


@pytest.mark.parametrize(("text", "target", "message"), BROKEN.values(), ids=BROKEN)
def test_a_broken_solver_is_an_error_only_when_named(offer, capsys, text, target, message):
    offer("fixed", text, target)
    for ask in (lambda: make("fixed"), lambda: select_solvers(["fixed"])):
        with pytest.raises(PluginError, match=rf"fixed.* of fable-solvers 1\.0 .*({message})"):
            ask()
    assert every_solver()["fixed"] is False
    runs, missing = select_solvers()
    assert "fixed" in missing
    assert "fixed" not in {run.name for run in runs}
    assert select_solvers(["newton"], "force") == ([("newton", "force", tl.solvers.Newton())], {})
    with pytest.raises(SystemExit) as left:
        main(["solvers", "--json"])
    assert not left.value.code
    listed = json.loads(capsys.readouterr().out)
    assert "fable-solvers" in listed["broken"]["fixed"]
    assert "newton" in {entry["solver"] for entry in listed["solvers"]}


def test_names_that_are_there_twice_or_have_a_colon_are_refused(offer):
    offer("fixed")
    offer("fixed", distribution="myth-solvers")
    offer("fixed:2", distribution="saga-solvers")
    with pytest.raises(PluginError, match=r"(fable|myth)-solvers 1\.0 and (fable|myth)-solvers 1\.0"):
        make("fixed")
    for name in ("fixed", "fixed:2"):
        assert every_solver()[name] is False
        assert name in select_solvers()[1]


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Write a module of this text to the working directory, which is not on Python's path; its name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [each for each in sys.path if each])

    def call(text=GOOD):
        name = f"fable_{next(NUMBER)}"
        Path(f"{name}.py").write_text(text)
        return name

    return call


@pytest.fixture
def importable(module, tmp_path, monkeypatch):
    """Write a module of this text where Python can import it; its name."""
    monkeypatch.syspath_prepend(tmp_path)
    return module


def test_a_class_of_a_module_that_python_can_import_is_a_solver(importable):
    name = importable()
    found = tl.allocate([[1.0, -1.0]], [0.0], (1.0, 5.0), solver=f"{name}:Fixed:3.5")
    assert found.tensions.tolist() == [3.5, 3.5]
    assert select_solvers([f"{name}:Fixed"])[0][0].solver.newtons == 2.0


@pytest.mark.parametrize("written", ["{}:Fixed", "{}.Fixed", "{}.py:Fixed", "no.{}:Fixed"])
def test_a_look_up_puts_no_folder_on_the_path(module, written):
    name, before = module("raise SystemError('loaded')"), list(sys.path)
    with pytest.raises(UnknownSolver):
        make(written.format(name))
    assert sys.path == before
    assert name not in sys.modules


def test_a_class_that_is_no_solver_and_a_module_that_is_not_there_are_told_apart(importable):
    name = importable("class Fixed:\n    def solve(self, problem): ...\n")
    message = rf"solver 'Fixed' \({name}:Fixed\) lacks objective, policies and is no dataclass; docs/how-to/add"
    with pytest.raises(PluginError, match=message):
        make(f"{name}:Fixed")
    with pytest.raises(PluginError, match=f"module '{name}' has no attribute 'Fixt'"):
        make(f"{name}:Fixt")
    for module in ("fable", "no.fable", "fable.py"):
        with pytest.raises(UnknownSolver, match=rf"no solver is called '{re.escape(module)}', and .*PYTHONPATH"):
            make(f"{module}:Fixed")
    with pytest.raises(UnknownSolver, match="did you mean 'qp'"):
        make("qpp:osqp")


def printed(folder, script):
    """What a program prints that has the folder on its path."""
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(folder)!r}); {script}"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_importing_tensionlab_neither_loads_nor_looks_for_it(tmp_path):
    install(tmp_path, "fable-solvers", {"fixed": "fable:Fixed"}, {"fable": "raise RuntimeError('loaded')"})
    script = "import tensionlab as tl; tl.allocate([[1.0, -1.0]], [0.0], (1.0, 5.0))\n"
    loaded = "print([name for name in ('fable', 'importlib.metadata') if name in sys.modules])"
    assert printed(tmp_path, script + loaded) == printed(tmp_path, loaded) == "[]\n"


def test_the_command_line_lists_and_compares_it(offer, run):
    offer("fixed")
    offer("lost", "", "Lost", "myth-solvers")
    _, out, _ = run("solvers")
    assert "nothing: all tensions alike" in out
    assert "Left out: solver 'lost' of myth-solvers 1.0" in out
    table = dict(tl.SOLVERS)
    try:
        tl.SOLVERS.clear()
        tl.SOLVERS["newton"] = tl.solvers.Newton  # one is enough
        _, out, _ = run("compare", RIG, "--directions", "fibonacci:2")
    finally:
        tl.SOLVERS.clear()
        tl.SOLVERS.update(table)  # in the same order
    rows = [line.split()[:2] for line in out.splitlines() if line.startswith(("fixed", "lost"))]
    assert rows == [["fixed", "–"]]
    assert "left out: lost, broken" in out
