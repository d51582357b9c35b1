"""What all pictures share: the style, the colours, and how they are written.

Pictures are byte-stable: the same result makes the same file, without dates in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import MissingDependency, ShapeError
from tensionlab.files import writing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase
    from matplotlib.lines import Line2D

STYLE = Path(__file__).parents[1] / "tensionlab.mplstyle"
BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#777777"
STATUS_LOOK = [
    ("exact", "#5A5A5A"),
    ("proved out of reach", "#BBBBBB"),
    ("neither proved", RED),
    ("failed", "#000000"),
]
"""Word and colour of each `Status`, in its order."""
METADATA: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}
"""By suffix, what must be left out for the same result to make the same file."""

HALO = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
"""Behind a name, so that lines do not cross it."""


def lines_of(entries: list[tuple[str, dict[str, Any]]]) -> list[Line2D]:
    """Make the lines that a legend shows, from words and looks."""
    from matplotlib.lines import Line2D

    return [Line2D([0, 1], [0, 0], label=label, **look) for label, look in entries]


def add_legend(figure: FigureBase, columns: int, entries: list[tuple[str, dict[str, Any]]]) -> None:
    """Put a legend below the pictures."""
    figure.legend(handles=lines_of(entries), loc="outside lower center", ncols=columns)


def legend_beside(axes: Axes, entries: list[tuple[str, dict[str, Any]]]) -> None:
    """Put a legend on the right of a picture."""
    axes.legend(handles=lines_of(entries), loc="upper left", bbox_to_anchor=(1.005, 1.05))


def _show_powers(figure: Figure) -> None:
    """Let the powers along logarithmic axes be mathematics, as Matplotlib writes them."""
    from matplotlib.axis import Axis

    for axis in figure.findobj(Axis):
        if axis.get_scale() != "linear":
            for label in (*axis.get_majorticklabels(), *axis.get_minorticklabels()):
                label.set_parse_math(True)


@contextmanager
def new_figure(path: str | Path, size: tuple[float, float], dpi: float | None = None) -> Iterator[Figure]:
    """Make a figure in the house's style, written without dates or versions when the block ends.

    The size is in inches; ``dpi``, the dots per inch of a PNG, is for large figures; None for the style's.
    """
    metadata = METADATA.get(Path(path).suffix.lower())
    if metadata is None:
        raise ShapeError(f"{path}: pictures end in {', '.join(METADATA)}")
    try:
        from matplotlib import rc_context, style
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependency("pictures need matplotlib: pip install matplotlib") from error
    with style.context(STYLE):
        figure = Figure(figsize=size, layout="constrained", dpi=dpi)
        FigureCanvasAgg(figure)
        with rc_context({"text.parse_math": False}):  # dollar signs in names are no mathematics
            yield figure
        _show_powers(figure)
        # The layout's solver leaves different last digits from run to run; the picture must not.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        for axes in figure.axes:
            axes.set_position(np.round(axes.get_position(original=True).bounds, 6))
        with writing.replacing(path) as file:
            kind = Path(path).suffix.lower()[1:]
            figure.savefig(file, format=kind, metadata=metadata, dpi="figure" if dpi else None)
