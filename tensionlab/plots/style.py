"""Style, legends, axes with two scales, point labels and files that all figures share.

Files are byte-stable: the same result makes the same file, without dates in it.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.errors import InputError
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, ORANGE, PURPLE, RED
from tensionlab.support.files import writing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase
    from matplotlib.lines import Line2D

Entry = tuple[str, dict[str, Any]]  # of a legend: a word, and the look of its line
STYLE = Path(__file__).parents[1] / "tensionlab.mplstyle"
SCREEN_DPI = 100  # resolution at which a browser shows a figure. Its PNG has more pixels, for fine screens.
METADATA: dict[str, dict[str, Any]] = {
    ".png": {"Software": None},
    ".pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    ".svg": {"Date": None, "Creator": None},
}  # by suffix, what must be left out for the same result to make the same file
# Behind a name, so that lines do not cross it.
HALO = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}

CURVES = (BLUE, ORANGE, GREEN, RED, PURPLE, "#56B4E9", "#000000", "#B8860B")
DASHES = ("-", "--", ":")
COARSE_SHADE = "#F4F1E6"
ONE_SCALE_UP_TO = 1.6  # multiple of the knee below which one scale is enough
FONT_SIZE = 8.0  # size of the letters, in points
DISTANCES = (7.0, 14.0, 24.0, 36.0, 50.0)  # distances of a name from its point that are tried, in points
POINT_RADIUS = 5.0  # half the size of a point, in points
DIRECTIONS = 16  # directions that are tried at each distance


def import_matplotlib() -> None:
    """Import Matplotlib, if it is installed, without the ``matplotlibrc`` of the working directory."""
    with chdir(STYLE.parent), suppress(ImportError):
        import matplotlib  # noqa: F401


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the style of tensionlab while the block lasts.

    Examples
    --------
    >>> import matplotlib.pyplot as plt
    >>> from tensionlab import plots
    >>> with plots.styled():
    ...     figure, axes = plt.subplots()
    """
    from matplotlib import rcParams, style

    with style.context(STYLE):
        yield
        # No part of the style: pyplot sets it as it makes its first figure, and shows no other without it.
        interactive = rcParams["interactive"]
    rcParams["interactive"] = interactive


@contextmanager
def new_figure(size: tuple[float, float], dpi: float | None = None) -> Iterator[Figure]:
    """Make a figure of a size in inches, complete when the block ends; ``dpi`` replaces the style's in PNG."""
    with styled():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.layout_engine import ConstrainedLayoutEngine

        layout = ConstrainedLayoutEngine()
        figure = Figure(figsize=size, layout=layout, dpi=dpi)
        FigureCanvasAgg(figure)
        with _plain_text(figure):
            yield figure
        # The layout's solver leaves different last digits from run to run; the file must not.
        layout.execute(figure)
        figure.set_layout_engine(None)
        for axes in figure.axes:
            axes.set_position(np.round(axes.get_position(original=True).bounds, 6))
    # In the class this would also change the figures of others.
    vars(figure)["_ipython_display_"] = lambda: _display(figure)


@contextmanager
def one_panel(
    ax: Axes | None, size: tuple[float, float], projection: str | None = None
) -> Iterator[tuple[Figure, Any]]:
    """Make a figure with one panel, or draw into a given panel; InputError if that has another projection."""
    if ax is None:
        with new_figure(size) as figure:
            yield figure, figure.add_subplot(projection=projection)
        return
    if ax.name != (projection or "rectilinear"):
        raise InputError(f'ax has the projection "{ax.name}"; give one with "{projection or "rectilinear"}"')
    with styled(), _plain_text(ax):
        yield ax.get_figure(root=True), ax  # type: ignore[misc]  # panels have a figure


@contextmanager
def _plain_text(artist: Artist) -> Iterator[None]:
    """Take dollar signs in names for no mathematics; but powers along logarithmic axes are."""
    from matplotlib import rc_context
    from matplotlib.axis import Axis

    with rc_context({"text.parse_math": False}):
        yield
    axis: Any
    for axis in artist.findobj(Axis):
        if axis.get_scale() != "linear":
            for label in (*axis.get_majorticklabels(), *axis.get_minorticklabels()):
                label.set_parse_math(True)


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure to a file, without dates or versions, or replace the file.

    The suffix of ``path`` chooses the format: png, pdf or svg; InputError for any other.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> plots.save_figure(plots.plot_rig(tl.load_rig("floor-3")), "rig.svg")
    """
    suffix = Path(path).suffix.lower()
    if suffix not in METADATA:
        raise InputError(f"{path}: unsupported image format; figures end in {', '.join(METADATA)}")
    with writing.replacing(path) as file:
        _write(figure, file, suffix)


def _display(figure: Figure) -> None:
    """Show a figure in a notebook: the PNG of `save_figure`, at the figure's size, so that it is crisp.

    IPython calls this before anything else, so it is the same whether pyplot is in use, which knows other figures.
    """
    from IPython.display import display

    buffer = BytesIO()
    _write(figure, buffer, ".png")
    png = {"image/png": b64encode(buffer.getvalue()).decode(), "text/plain": repr(figure)}
    width = round(figure.get_figwidth() * SCREEN_DPI)
    display(png, raw=True, metadata={"image/png": {"width": width}})  # type: ignore[no-untyped-call]


def _write(figure: Figure, file: IO[bytes], suffix: str) -> None:
    from matplotlib import rcParams

    with styled():
        dpi: Any = "figure" if figure.dpi != rcParams["figure.dpi"] else None
        figure.savefig(file, format=suffix[1:], metadata=METADATA[suffix], dpi=dpi)


def curve_look(index: int) -> dict[str, Any]:
    """Return colour and dashes of one of several curves."""
    return {"color": CURVES[index % len(CURVES)], "linestyle": DASHES[index // len(CURVES) % len(DASHES)]}


def lines_of(entries: Sequence[Entry]) -> list[Line2D]:
    """Return the lines of a legend, from words and looks."""
    from matplotlib.lines import Line2D

    return [Line2D([0, 1], [0, 0], label=label, **look) for label, look in entries]


def add_legend(figure: FigureBase, columns: int, entries: Sequence[Entry], ax: Axes | None = None) -> None:
    """Put a legend below the panels, or where there is room in a given panel."""
    if ax is None:
        figure.legend(handles=lines_of(entries), loc="outside lower center", ncols=columns)
    else:
        ax.legend(handles=lines_of(entries))


def legend_beside(axes: Axes, entries: Sequence[Entry]) -> None:
    """Put a legend on the right of a panel."""
    axes.legend(handles=lines_of(entries), loc="upper left", bbox_to_anchor=(1.005, 1.05))


def two_scales(axes: Axes, values: Floats, knee: float) -> bool:
    """Set the range of the vertical axis to what is drawn; return whether it has two scales.

    Beyond the knee, up and down, the scale is logarithmic, and shaded, if linear it would hide what is below.
    """
    from matplotlib.ticker import MaxNLocator

    low: float = np.nanmin(values, initial=0.0)
    high: float = np.nanmax(values, initial=0.0)
    largest = max(high, -low)
    if largest <= ONE_SCALE_UP_TO * knee:
        spare = 0.06 * max(high - low, 0.1)
        axes.set_ylim(low - spare if low < 0.0 else 0.0, high + spare)
        return False
    axes.set_yscale("symlog", linthresh=knee)
    bottom, top = (1.15 * end if abs(end) > knee else end + 0.05 * np.sign(end) * knee for end in (low, high))
    fine = np.asarray(MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(0.0, 0.9 * knee))
    coarse = np.outer(10.0 ** np.arange(6), [1.0, 2.0, 4.0]).ravel()
    sizes = np.concatenate([fine[fine < knee], coarse[coarse > 1.3 * knee]])
    ticks = np.unique(np.concatenate([-sizes, sizes])) + 0.0  # not -0
    axes.set_yticks(ticks[(ticks >= bottom) & (ticks <= top)])
    axes.minorticks_off()
    axes.yaxis.set_major_formatter("{x:g}")
    for edge, end in ((knee, top), (-knee, bottom)):
        if edge * end > 0.0 and abs(end) > knee:
            axes.axhspan(edge, end, color=COARSE_SHADE, linewidth=0.0, zorder=0)
    axes.set_ylim(bottom, top)
    return True


def label_points(figure: Figure, axes: Axes, points: Mapping[str, Sequence[tuple[float, float]]]) -> None:
    """Write each name next to the first of its points (x, y), where it covers least and none of the points.

    Points without a name ("") are kept clear as well. Figure and axes are complete but for the names: where things
    are is known only then.
    """
    if layout := figure.get_layout_engine():
        layout.execute(figure)
    axes.apply_aspect()
    scale = 72.0 / figure.dpi  # from pixels to points
    frame = scale * axes.get_window_extent().get_points()
    places = {name: scale * axes.transData.transform(np.array(ends)) for name, ends in points.items()}
    all_places = np.concatenate([np.zeros((0, 2)), *places.values()])
    taken = np.hstack([all_places - POINT_RADIUS, all_places + POINT_RADIUS])
    # Names in a crowd first: they have the least choice.
    crowd = {name: -(np.hypot(*(all_places - ends[0]).T) < 40.0).sum() for name, ends in places.items()}
    for name in sorted(filter(None, points), key=lambda name: (crowd[name], name)):
        place = places[name][0]
        others = np.concatenate([np.zeros((0, 2)), *(ends for other, ends in places.items() if other != name)])
        width, height = 0.6 * FONT_SIZE * len(name), 1.2 * FONT_SIZE
        best = free_box(place, (width, height), others, taken, frame)
        taken = np.vstack([taken, best])
        middle = (best[:2] + best[2:]) / 2
        far = np.hypot(*(middle - place)) > max(width, height) / 2 + 12.0
        axes.annotate(
            name, points[name][0], xytext=middle - place, textcoords="offset points", ha="center", va="center",
            fontsize=FONT_SIZE, color="#222222", zorder=5, bbox=HALO,
            arrowprops={"arrowstyle": "-", "color": "#999999", "linewidth": 0.6, "shrinkB": 3} if far else None,
        )  # fmt: skip


def free_box(
    place: Floats, size: tuple[float, float], others: Floats, taken: Floats, frame: Floats
) -> NDArray[np.float64]:
    """Return the box (left, bottom, right, top) of a size near a place, (2,), for the name of that point.

    Of some around it, it covers least of the boxes ``taken`` (k, 4), sticks out least of the ``frame`` (2, 2), and
    is near the place, and nearer than to ``others`` (k, 2). All are in points.
    """
    half, angle = np.array(size) / 2, 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    toward = np.tile(np.column_stack([np.cos(angle), np.sin(angle)]), (len(DISTANCES), 1))
    away = np.repeat(DISTANCES, DIRECTIONS)
    middle = place + toward * (away + np.abs(toward) @ half)[:, None]
    low, high = middle - half, middle + half
    overlap = np.minimum(high[:, None], taken[:, 2:]) - np.maximum(low[:, None], taken[:, :2])
    covered = np.maximum(overlap, 0.0).prod(axis=2).sum(axis=1)
    outside = (np.maximum(frame[0] - low, 0.0) + np.maximum(high - frame[1], 0.0)).sum(axis=1)

    def distance(points: Floats) -> Floats:
        """Return the distance of points (k, 2) from each box."""
        gap = np.maximum(np.maximum(low[:, None] - points, points - high[:, None]), 0.0)
        return np.asarray(np.linalg.norm(gap, axis=2))

    own = distance(place[None])
    closer = np.maximum(own + 6.0 - distance(others), 0.0).sum(axis=1)
    best = np.argmin(100.0 * (covered + outside) + 3.0 * closer + own[:, 0])
    return np.concatenate([low[best], high[best]])
