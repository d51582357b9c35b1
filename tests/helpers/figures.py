"""What is in figures."""

import re
import tempfile
from pathlib import Path

from matplotlib.figure import Figure

from tensionlab.plots.style import save_figure


def words_of(path: Path) -> list[str]:
    """Return every text in an SVG, which matplotlib keeps as comments with the outlines."""
    return words_in(path.read_bytes())


def words_in(content: bytes) -> list[str]:
    """Return every text in the content of an SVG."""
    return re.findall(r"<!-- (.*?) -->", content.decode("utf-8"))


def content_of(figure: Figure) -> bytes:
    """Return all that is drawn, as an SVG."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "figure.svg"
        save_figure(figure, path)
        return path.read_bytes()
