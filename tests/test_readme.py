"""What the README promises: its Python runs and its files exist."""

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


def test_its_files_exist() -> None:
    named = re.findall(r"`((?:[a-z_]+/)+[\w.-]*|[A-Z]+\.(?:md|cff))`", README) + re.findall(
        r"\]\(([^)]+)\)", README
    )
    assert len(named) > 5
    for name in named:
        assert (ROOT / name).exists(), name
