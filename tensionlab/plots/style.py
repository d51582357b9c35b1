"""What all figures share: style, colours, legends, an axis with two scales, and how files are written.

Files are byte-stable: the same result makes the same file, without dates in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.errors import InputError, MissingDependency
from tensionlab.files import writing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase
    from matplotlib.lines import Line2D

STYLE = Path(__file__).parents[1] / "tensionlab.mplstyle"
BLUE, ORANGE, GREEN, RED, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#777777"
STATUS_LOOK = [
    ("exact", "#5A5A5A"),
    ("certified infeasible", "#BBBBBB"),
    ("unproven (iteration limit)", RED),
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

COARSE_SHADE = "#F4F1E6"
COARSE_SHARE = 0.45
"""Share of a panel that the coarse scale takes."""
ONE_SCALE_UP_TO = 1.6
"""Below so many times the knee, one scale is enough."""
MIN_TICKS = 2.5
"""At least so many steps from tick to tick fit on the fine scale."""


@contextmanager
def new_figure(size: tuple[float, float], dpi: float | None = None) -> Iterator[Figure]:
    """Make a figure in the style of tensionlab, complete when the block ends; a notebook shows it.

    The size is in inches; ``dpi``, the dots per inch of a PNG, is for large figures; None for the style's.
    """
    try:
        from matplotlib import rc_context, style
        from matplotlib.axis import Axis
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependency("figures need matplotlib: pip install matplotlib") from error
    with style.context(STYLE):
        figure = Figure(figsize=size, layout="constrained", dpi=dpi)
        FigureCanvasAgg(figure)
        with rc_context({"text.parse_math": False}):  # dollar signs in names are no mathematics
            yield figure
        for axis in figure.findobj(Axis):  # but powers along logarithmic axes are
            if axis.get_scale() != "linear":
                for label in (*axis.get_majorticklabels(), *axis.get_minorticklabels()):
                    label.set_parse_math(True)
        # The layout's solver leaves different last digits from run to run; the file must not.
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
        for axes in figure.axes:
            axes.set_position(np.round(axes.get_position(original=True).bounds, 6))
    vars(figure)["_repr_png_"] = lambda: _png(figure)


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure to a file, without dates or versions; the suffix chooses the format: png, pdf or svg.

    Raises
    ------
    InputError
        If the suffix is no such format.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in METADATA:
        raise InputError(f"{path}: unsupported image format; figures end in {', '.join(METADATA)}")
    with writing.replacing(path) as file:
        _write(figure, file, suffix)


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    _write(figure, buffer, ".png")
    return buffer.getvalue()


def _write(figure: Figure, file: IO[bytes], suffix: str) -> None:
    from matplotlib import rcParams, style

    with style.context(STYLE):
        dpi: Any = "figure" if figure.dpi != rcParams["figure.dpi"] else None
        figure.savefig(file, format=suffix[1:], metadata=METADATA[suffix], dpi=dpi)


def lines_of(entries: list[tuple[str, dict[str, Any]]]) -> list[Line2D]:
    """Make the lines that a legend shows, from words and looks."""
    from matplotlib.lines import Line2D

    return [Line2D([0, 1], [0, 0], label=label, **look) for label, look in entries]


def add_legend(figure: FigureBase, columns: int, entries: list[tuple[str, dict[str, Any]]]) -> None:
    """Put a legend below the panels."""
    figure.legend(handles=lines_of(entries), loc="outside lower center", ncols=columns)


def legend_beside(axes: Axes, entries: list[tuple[str, dict[str, Any]]]) -> None:
    """Put a legend on the right of a panel."""
    axes.legend(handles=lines_of(entries), loc="upper left", bbox_to_anchor=(1.005, 1.05))


def two_scales(axes: Axes, values: Floats, knee: float) -> bool:
    """Set the range of the vertical axis, with a coarse scale beyond a knee if that is needed.

    Parameters
    ----------
    axes : Axes
    values : array
        All that is drawn; NaN is left out.
    knee : float
        Beyond it, up and down, the scale is coarse, and shaded.

    Returns
    -------
    bool
        Whether there are two scales.
    """
    low = min(0.0, float(np.nanmin(values, initial=0.0)))
    high = max(0.0, float(np.nanmax(values, initial=0.0)))
    most = 1.05 * max(high, -low)
    if most <= ONE_SCALE_UP_TO * knee:
        spare = 0.06 * max(high - low, 0.1)
        axes.set_ylim(low - spare if low < 0.0 else 0.0, high + spare)
        return False
    slope = COARSE_SHARE / (1.0 - COARSE_SHARE) * knee / (most - knee)

    def bend(value: Any, slope: float) -> Floats:
        size = np.abs(value)
        return np.asarray(np.sign(value) * np.where(size > knee, knee + slope * (size - knee), size))

    axes.set_yscale(
        "function", functions=(lambda value: bend(value, slope), lambda value: bend(value, 1.0 / slope))
    )
    bottom = 1.05 * low if low < -knee else low - 0.05 * knee if low < 0.0 else 0.0
    top = 1.05 * high if high > knee else high + 0.05 * knee
    axes.set_ylim(bottom, top)
    fine, coarse = _round_step(knee / MIN_TICKS), _round_step((most - knee) / 2.0)
    above = np.arange(coarse, most, coarse)
    sizes = [*np.arange(0.0, 0.9 * knee, fine), *above[above > knee + 0.1 * (most - knee)]]
    ticks = sorted({sign * float(size) for size in sizes for sign in (1.0, -1.0)})
    axes.set_yticks([tick for tick in ticks if bottom <= tick <= top], minor=False)
    axes.minorticks_off()
    axes.yaxis.set_major_formatter("{x:g}")
    for edge, end in ((knee, top), (-knee, bottom)):
        if edge * end > 0.0 and abs(end) > knee:
            axes.axhspan(edge, end, color=COARSE_SHADE, linewidth=0.0, zorder=0)
    return True


def _round_step(step: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that is at most the step."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(each * power for each in (5.0, 2.0, 1.0) if each * power <= step * (1.0 + 1e-9))
