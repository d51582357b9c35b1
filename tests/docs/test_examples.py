"""The docstrings of the reference: every public name has an example that runs, and says what its arguments are.

The example may be in the docstring of its package, which shows names together that are only used together. A
figure may be in the gallery, whose cells run when the site is built; a result has the example of the function that
returns it.
"""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
LISTED = re.findall(
    r"^   ~(tensionlab\.[\w.]+)$",
    "\n".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "docs" / "reference").glob("*.md"))),
    re.MULTILINE,
)  # the names that the pages of the reference list
MODULES = (
    "tensionlab",
    "tensionlab.workspace",
    "tensionlab.datasets",
    "tensionlab.plots",
    "tensionlab.hardware",
    "tensionlab.haptics.effects",
    "tensionlab.scenarios",
    "tensionlab.mujoco",
)  # where every name is in the reference, with an example
# Public, but for nobody to look up: what files are saved with, and an old name.
CONSTANTS = {"tensionlab.plots.METADATA"}
NEVER_FAIL = {"tensionlab.get_include", "tensionlab.haptics.effects.relative"}  # functions that take nothing wrong


def find(name: str) -> Any:
    """The object of a listed name."""
    module, _, last = name.rpartition(".")
    return getattr(importlib.import_module(module), last)


def public(modules: tuple[str, ...]) -> Iterator[str]:
    """Public names of modules; those that stand for another module are left out."""
    for module in modules:
        there = importlib.import_module(module)
        yield from (f"{module}.{name}" for name in there.__all__ if not inspect.ismodule(getattr(there, name)))


def explained(found: Any) -> bool:
    """Whether an object has a docstring of its own: a class or a function, no constant and no alias of a type."""
    return inspect.isclass(found) or inspect.isfunction(found)


def examples(found: Any) -> list[doctest.DocTest]:
    """Examples of an object and, if it is a class, of its methods."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    tests = {test.name: test for test in finder.find(found, found.__name__, module=False, globs={})}
    return [test for _, test in sorted(tests.items()) if test.examples]


def test_the_reference_lists_every_public_name() -> None:
    listed = {id(find(name)) for name in LISTED}
    missing = [name for name in public(MODULES) if id(find(name)) not in listed and name not in CONSTANTS]
    assert missing == []


def test_no_name_is_listed_twice() -> None:
    assert sorted(LISTED) == sorted(set(LISTED))


RUN_A_BENCHMARK = ("plot_profile",)
CALLABLE = [
    pytest.param(name, marks=[pytest.mark.slow] * name.endswith(RUN_A_BENCHMARK))
    for name in LISTED
    if explained(find(name))
]


@pytest.mark.parametrize("name", CALLABLE)
def test_examples_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    flags = doctest.ELLIPSIS | doctest.FAIL_FAST
    said: list[str] = []
    with np.printoptions(precision=8, suppress=False):
        for test in examples(find(name)):
            doctest.DocTestRunner(optionflags=flags, verbose=False).run(test, out=said.append)
    plt.close("all")
    assert not said, "".join(said)


@pytest.mark.parametrize("module", ["tensionlab.haptics.effects", "tensionlab.hardware", "tensionlab.scenarios"])
def test_examples_of_packages_run(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert doctest.testmod(importlib.import_module(module)).failed == 0


def test_every_public_name_has_an_example() -> None:
    gallery = (ROOT / "docs" / "gallery" / "plots.md").read_text(encoding="utf-8")
    explainable = [name for name in public(MODULES) if explained(find(name))]
    functions = [found for name in explainable if inspect.isfunction(found := find(name)) and examples(found)]
    returned = {str(inspect.signature(found).return_annotation) for found in functions}

    def shown(name: str) -> bool:
        module, _, last = name.rpartition(".")
        text = importlib.import_module(module).__doc__ or ""
        together = ">>>" in text and re.search(rf"\b{last}\b", text) is not None
        return together or f"plots.{last}(" in gallery or last in returned

    assert [name for name in explainable if not examples(find(name)) and not shown(name)] == []


def test_what_is_in_single_backticks_is_a_name() -> None:
    """The site makes links of them; commands and paths are in two."""
    texts = {name: inspect.getdoc(find(name)) or "" for name in public(MODULES)}
    for name in public(MODULES):
        if inspect.isclass(found := find(name)):
            texts |= {f"{name}.{key}": inspect.getdoc(each) or "" for key, each in vars(found).items()}
    marked = [(name, bare) for name, text in texts.items() for bare in re.findall(r"(?<!`)`([^`]+)`(?!`)", text)]
    assert [pair for pair in marked if re.search(r"[^\w.~]", pair[1])] == []


@pytest.mark.parametrize("module", MODULES)
def test_functions_explain_their_arguments(module: str) -> None:
    """Each is named in the docstring, or the docstring says where they are explained."""
    unexplained = []
    for name in public((module,)):
        found = find(name)
        if not inspect.isfunction(found):
            continue
        text = inspect.getdoc(found) or ""
        there = " as in `" in text or " as those of `" in text
        for parameter in inspect.signature(found).parameters:
            if not re.search(rf"\b{parameter}\b", text) and not there:
                unexplained.append(f"{name}: {parameter}")
    assert unexplained == []


@pytest.mark.parametrize("module", [module for module in MODULES if module != "tensionlab.plots"])
def test_functions_name_their_errors(module: str) -> None:
    silent = []
    for name in public((module,)):
        found = find(name)
        text = inspect.getdoc(found) or ""
        if (
            inspect.isfunction(found)
            and name not in NEVER_FAIL
            and not re.search(r"Error\b|errors? (are )?as|UnknownSolver|MissingDependency", text)
        ):
            silent.append(name)
    assert silent == []


def test_an_example_that_is_wrong_is_seen() -> None:
    def wrong() -> None:
        """Add.

        >>> 1 + 1
        3
        """

    (test,) = examples(wrong)
    said: list[str] = []
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    assert "Expected:\n    3" in "".join(said)
