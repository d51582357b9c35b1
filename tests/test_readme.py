"""Promises of README, CONTRIBUTING and the pages of docs: their Python runs, their files exist, they are short."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_its_example_prints_what_it_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    code, *_ = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    (shown,) = re.findall(r"```text\n(.*?)```", README, flags=re.DOTALL)
    exec(code, {})
    without_rounding = [re.sub(r"[\d.]+e-1\d$", "0", line) for line in capsys.readouterr().out.splitlines()]
    assert without_rounding == [re.sub(r"[\d.]+e-1\d$", "0", line) for line in shown.splitlines()]


PAGES = [path for path in sorted((ROOT / "docs").rglob("*.md")) if "generated" not in path.parts]
DOCUMENTS = [*sorted(ROOT.glob("*.md")), ROOT / "paper" / "README.md", *PAGES]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_files_that_are_named_exist(path: Path) -> None:
    text = path.read_text()
    for name in re.findall(r"\]\(([^)#:]+)\)", text):
        assert (path.parent / name).exists(), name
    for name in re.findall(r"`((?:[a-z_]+/)+[\w.-]*|[A-Z]+\.(?:md|cff))`", text):
        there = (ROOT / name, ROOT / "tensionlab" / name, ROOT / "include" / name)
        assert any(each.exists() for each in there) or name.startswith("out/") or "dual_ascent" in name, name


@pytest.mark.parametrize(("name", "most"), [("README.md", 4000), ("CONTRIBUTING.md", 6000)])
def test_the_way_in_is_short(name: str, most: int) -> None:
    assert len((ROOT / name).read_text()) <= most
