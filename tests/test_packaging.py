"""What packagers read says what pyproject.toml says, and the workflows pin their actions by hash."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
RECIPE = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
OTHER_NAMES = {"matplotlib": "matplotlib-base"}  # of conda-forge


def listed(section: str) -> set[str]:
    """Return the requirements in a section of the recipe."""
    (text,) = re.findall(rf"^  {section}:\n((?:    .*\n)+)", RECIPE, re.MULTILINE)
    return set(re.findall(r"^    - (.+)$", text, re.MULTILINE))


def named(requirements: list[str]) -> set[str]:
    """Return requirements as conda writes them."""
    parts = [re.fullmatch(r"([\w-]+)>=([\d.]+)", each) for each in requirements]
    return {f"{OTHER_NAMES.get(part[1], part[1])} >={part[2]}" for part in parts if part}


def test_the_recipe_requires_what_the_package_requires() -> None:
    assert listed("run") - {"python"} == named(PYPROJECT["project"]["dependencies"])
    assert listed("host") - {"python", "pip"} == named(PYPROJECT["build-system"]["requires"])


def test_the_recipe_is_of_this_version() -> None:
    assert f'version: "{PYPROJECT["project"]["version"]}"' in RECIPE
    assert f'"<{PYPROJECT["project"]["requires-python"].removeprefix(">=")}"' in RECIPE


def test_the_changelog_begins_with_this_version() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    (first, *_) = re.findall(r"^## (\S+)", changelog, re.MULTILINE)
    assert first == PYPROJECT["project"]["version"]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_pins_its_actions_and_grants_no_more_than_it_says(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for action in re.findall(r"uses: (.+)", text):
        assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # .+", action), action
    assert re.search(r"^permissions:( \{\}$|\n  contents: read\n(?! ))", text, re.MULTILINE)
    assert text.count("timeout-minutes:") == text.count("runs-on:")


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_calls_targets_that_exist(path: Path) -> None:
    targets = set(re.findall(r"^([\w./-]+)(?: [\w./-]+)*:", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    text = path.read_text(encoding="utf-8")
    called = set(re.findall(r"run: make ([\w./-]+)", text))
    if matrix := re.search(r"target: \[(.+)\]", text):
        called |= set(matrix[1].split(", "))
    assert called <= targets
