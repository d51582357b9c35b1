"""Words in figures."""

import re
from pathlib import Path


def words_of(path: Path) -> list[str]:
    """Return every text in an SVG, which matplotlib keeps as comments beside the outlines."""
    return re.findall(r"<!-- (.*?) -->", path.read_text(encoding="utf-8"))
