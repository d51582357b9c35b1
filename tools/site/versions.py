"""Put a built site beside other versions: ``python -m tools.site.versions SITE FOLDER VERSION ADDRESS``."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

PAGE = '<!doctype html><meta http-equiv="refresh" content="0; url={0}/"><a href="{0}/">tensionlab</a>\n'


def add(site: Path, folder: Path, version: str, address: str) -> None:
    """Add or replace a version in a folder served at an address, whose page leads to the newest release."""
    shutil.rmtree(folder / version, ignore_errors=True)
    shutil.copytree(site, folder / version)
    versions = [path.parents[1].name for path in folder.glob("*/docs/index.html")]
    versions.sort(key=lambda name: [int(part) for part in re.findall(r"\d+", name)], reverse=True)
    new = versions[0]
    entries = [{"version": name, "url": f"{address}/{name}/", "preferred": name == new} for name in versions]
    (folder / "switcher.json").write_text(json.dumps(entries, indent=1) + "\n")
    (folder / "index.html").write_text(PAGE.format(new))
    (folder / ".nojekyll").touch()


if __name__ == "__main__":
    add(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
