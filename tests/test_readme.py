"""Promises of README, CONTRIBUTING and the pages of docs: their Python runs, their files exist, they are short."""

import re
from pathlib import Path

import pytest

import tensionlab as tl

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_its_example_renders_the_force(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    exec(code, names)
    assert names["result"].status == tl.Status.EXACT  # type: ignore[attr-defined]
    assert capsys.readouterr().out.startswith("EXACT: tensions [")


PAGES = [path for path in sorted((ROOT / "docs").rglob("*.md")) if "generated" not in path.parts]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *PAGES]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_files_that_are_named_exist(path: Path) -> None:
    text = path.read_text()
    for name in re.findall(r"\]\(([^)#:]+)\)", text):
        assert (path.parent / name).exists(), name
    for name in re.findall(r"`((?:[a-z_]+/)+[\w.-]*|[A-Z]+\.(?:md|cff))`", text):
        there = (ROOT / name, ROOT / "tensionlab" / name)
        assert any(each.exists() for each in there) or name.startswith("out/") or "dual_ascent" in name, name


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_the_way_in_is_short(name: str) -> None:
    assert len((ROOT / name).read_text()) <= 6000
