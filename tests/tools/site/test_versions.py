"""Sites of several versions stand beside each other; the newest release is the one that is opened."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tools.site.versions import add


@pytest.fixture
def site(tmp_path: Path) -> Path:
    page = tmp_path / "site" / "docs" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text("first")
    return tmp_path / "site"


def test_the_newest_release_is_first_and_no_version_is_lost(site: Path, tmp_path: Path) -> None:
    pages = tmp_path / "pages"
    for version in ("v1.9.0", "dev", "v1.10.0"):
        add(site, pages, version, "https://example.org/x")
    entries = json.loads((pages / "switcher.json").read_text())
    assert [entry["version"] for entry in entries] == ["v1.10.0", "v1.9.0", "dev"]
    assert [entry["preferred"] for entry in entries] == [True, False, False]
    assert entries[1]["url"] == "https://example.org/x/v1.9.0/"
    assert 'url=v1.10.0/"' in (pages / "index.html").read_text()


def test_a_version_is_replaced_as_a_whole(site: Path, tmp_path: Path) -> None:
    pages = tmp_path / "pages"
    add(site, pages, "dev", "https://example.org")
    (pages / "dev" / "old.html").write_text("old")
    (site / "docs" / "index.html").write_text("second")
    add(site, pages, "dev", "https://example.org")
    assert not (pages / "dev" / "old.html").exists()
    assert (pages / "dev" / "docs" / "index.html").read_text() == "second"
    assert 'url=dev/"' in (pages / "index.html").read_text()
