"""Figures of a benchmark: time against accuracy, and performance profile."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, overload

import numpy as np

from tensionlab.benchmark.comparison import Comparison
from tensionlab.errors import InputError
from tensionlab.plots.style import Entry, add_legend, curve_look, label_points, new_figure, one_panel
from tensionlab.solvers import is_built_in
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, RED

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tensionlab.benchmark.results import Results

EXACT_N = 1e-6  # an answer with an error up to this is exact, as the interface verifies
MIN_ERROR_N = 1e-16  # errors below are drawn here: rounding
NO_ANSWER_N = 1e3  # where an entry is drawn whose errors are larger, or that gave too few answers
SIZE = (8.0, 5.2)  # size of a figure of time against accuracy, in inches
LOOKS = {
    "own": ("your own", PURPLE, "*"),
    "newton": ("newton", BLUE, "o"),
    "built-in": ("built-in, others", GREEN, "s"),
    "default": ("baseline, default settings", ORANGE, "o"),
    "tight": ("baseline, tight settings", RED, "D"),
}  # name, colour and marker of each kind of entry
UNNAMED = ("#C4C4C4", "o")  # colour and marker of entries without a name
RIVALS = ("analytic-centre", "closed-form", "quadprog", "daqp", "osqp")
MAX_NAMED = 8  # of more entries only newton, those of one's own and `RIVALS` have names
FRONT_LINE: dict[str, Any] = {"color": "#444444", "linewidth": 1.0, "linestyle": "--"}
MAX_RATIO = 1e4  # ratios above are not drawn
COLUMNS = 5  # entries in a row of the legend, at most
T = TypeVar("T")


class Dot(NamedTuple):
    """One entry: its name, its kind in `LOOKS`, its time in s and its error in N (infinite: no answer)."""

    name: str
    kind: str
    time: float
    error: float


@overload
def plot_pareto(results: Results | Comparison, *, ax: None = None) -> Figure: ...
@overload
def plot_pareto(results: Results | Comparison, *, ax: Axes) -> None: ...
def plot_pareto(results: Results | Comparison, *, ax: Axes | None = None) -> Figure | None:
    """Draw the time and the worst error of each solver, and the Pareto front of both.

    Solvers that do not come with tensionlab are stars. Of a benchmark, which needs no measurements of single
    problems: across, the median call in the feasible sets, as the geometric mean over the sets; up, the largest
    error of all, of the wrench or the limits. Those that did not answer all problems are at the top. Of a
    comparison, each solver with its own policy: across, the median call; up, how much larger than the smallest of
    all solvers its error is for the same force, at most. Of many solvers only newton, five well-known rivals and
    your own have names and colours. The title says who answers exactly in the shortest time.

    The results are those of `tensionlab.benchmark.run`, `tensionlab.datasets.load` or `tensionlab.compare`, ``ax``
    is as in `plot_rig`.
    """
    if isinstance(results, Comparison):
        up = "max error above the smallest of all (N)"
        return _plot_dots(_compared(results), "median time of a call (µs)", up, ax)
    rows = results.rows[results.rows["problem_set"].isin(results.feasible_sets)]
    rows = rows[np.isfinite(rows["median_s"])].drop_duplicates(["label", "problem_set"])
    dots = []
    for label, own in rows.groupby("label", sort=False):
        if len(own) < len(results.feasible_sets):
            continue
        answered = not (own["refused"] + own["failed"]).any()
        error = float(own[["error_max", "violation_max"]].max(axis=None)) if answered else np.inf
        time = float(np.exp(np.log(own["median_s"]).mean()))
        first = own.iloc[0]
        name = short_name(str(label)).partition(",")[0]
        dots.append(Dot(name, kind(first["solver"], first["setting"]), time, error))
    if not dots:
        raise InputError("no answers in these results that could be drawn")
    return _plot_dots(dots, "typical time of a call (µs)", "max error of all answers (N)", ax)


def _compared(comparison: Comparison) -> list[Dot]:
    """Return each solver of a comparison with its own policy."""
    error = np.array([allocation.residual for allocation in comparison.allocations])
    excess = np.where(np.isnan(error), np.inf, error - np.nanmin(error, axis=0)).max(axis=1)
    return [
        Dot(name, kind(name), comparison.rows[number].call_median_s, float(excess[number]))
        for name, number in comparison.own_policies.items()
    ]


def _plot_dots(dots: Sequence[Dot], across: str, up: str, ax: Axes | None) -> Figure | None:
    """Draw entries as dots with names; a line leads from a baseline's default settings to its tight ones."""
    named = _named(dots, lambda dot: dot.name, lambda dot: dot.kind)
    others = [dot for dot in dots if dot not in named]
    with one_panel(ax, SIZE) as (figure, axes):
        points = _draw_dots(axes, named, others)
        axes.set(xlabel=across, ylabel=up, title=_fastest_exact(dots))
        kinds = [LOOKS[kind] for kind in LOOKS if any(dot.kind == kind for dot in named)]
        kinds += [("other solvers", *UNNAMED)] if others else []
        looks: list[Entry] = [
            (name, {"color": colour, "marker": marker, "ls": ""}) for name, colour, marker in kinds
        ]
        columns = 1 + len(looks) if len(looks) < COLUMNS else 1 + len(looks) // 2
        add_legend(figure, columns, [*looks, ("Pareto front", FRONT_LINE)], ax)
        label_points(figure, axes, points)
    return figure if ax is None else None


def _fastest_exact(dots: Sequence[Dot]) -> str:
    """Return the title: who answers exactly in the shortest time, and who is next."""
    times = {dot.name: dot.time for dot in sorted(dots, key=lambda dot: -dot.time) if dot.error <= EXACT_N}
    first, *following = sorted(times, key=lambda name: times[name]) or [""]
    if not first:
        return "No solver answers exactly"
    title = f"{first} answers exactly in {1e6 * times[first]:.2g} µs"
    return title + (f", {following[0]}, the next, in {1e6 * times[following[0]]:.2g} µs" if following else "")


def _draw_dots(axes: Axes, named: Sequence[Dot], others: Sequence[Dot]) -> dict[str, list[tuple[float, float]]]:
    """Draw entries as dots, with the scales; return where those of each named entry are."""
    places = {
        dot: (1e6 * dot.time, NO_ANSWER_N if not dot.error <= NO_ANSWER_N else max(dot.error, MIN_ERROR_N))
        for dot in (*named, *others)
    }
    for dot in others:
        axes.plot(*places[dot], UNNAMED[1], color=UNNAMED[0], markersize=5.0, zorder=2)
    points: dict[str, list[tuple[float, float]]] = {}
    for dot in named:
        _, colour, marker = LOOKS[dot.kind]
        size, front = (13.0, 4) if dot.kind == "own" else (6.5, 3)
        axes.plot(*places[dot], marker=marker, color=colour, linestyle="", markersize=size, zorder=front)
        points.setdefault(dot.name, []).append(places[dot])
    for ends in points.values():
        axes.plot(*zip(*ends, strict=True), color="#BBBBBB", linewidth=1.0, zorder=2)
    x, y = zip(*pareto_front(list(places.values())), strict=True)
    axes.step([x[0], *x, 1e12], [NO_ANSWER_N, *y, y[-1]], where="post", zorder=1, **FRONT_LINE)
    axes.axhline(EXACT_N, color=GREY, linewidth=0.8, linestyle=":", zorder=1)
    axes.annotate("exact below this line", (1, EXACT_N), xycoords=("axes fraction", "data"), xytext=(-3, -3),
                  textcoords="offset points", ha="right", va="top", fontsize=8, color=GREY)  # fmt: skip
    axes.set(xscale="log", yscale="log", ylim=(MIN_ERROR_N, 10 * NO_ANSWER_N))
    ticks = 10.0 ** np.arange(-15, 1, 3)
    powers = [f"$10^{{{round(np.log10(tick))}}}$" for tick in ticks]
    axes.set_yticks([*ticks, NO_ANSWER_N], [*powers, "over $10^3$,\nor none"], parse_math=True)
    axes.minorticks_off()
    axes.grid()
    times, errors = np.array(list(places.values())).T
    axes.set_ylim(max(MIN_ERROR_N, 0.01 * min(errors)))
    axes.set_xlim(min(times) / 1.6, 1.6 * max(times))
    wide = max(times) > 1e4 * min(times)
    ticks = np.outer(10.0 ** np.arange(-1, 10), [1] if wide else [1, 2, 5]).ravel()
    ticks = ticks[(ticks > min(times) / 1.6) & (ticks < 1.6 * max(times))]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    return points


def pareto_front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points (time, error), by time, that no other one surpasses in one and equals in the other.

    Errors up to `EXACT_N` are equal, and that large.
    """
    front: list[tuple[float, float]] = []
    for time, error in sorted((time, max(error, EXACT_N)) for time, error in points):
        if not front or error < front[-1][1]:
            front.append((time, error))
    return front


def kind(solver: str, setting: str = "proved") -> str:
    """Return the kind of an entry, a key of `LOOKS`."""
    if setting != "proved":
        return setting
    return "newton" if solver == "newton" else "built-in" if is_built_in(solver) else "own"


def short_name(label: str) -> str:
    """Return the name of an entry in figures: without qpsolvers, but for the baseline that is there twice."""
    short = label.removeprefix("qpsolvers:")
    return short.replace("daqp", "daqp (qpsolvers)") if short != label else short


def plot_profile(results: Results) -> Figure:
    """Draw the share of the problems that each entry solves within a multiple of the fastest time.

    Dolan and Moré's performance profile, over all feasible sets, of answers to 1e-6 N. Names and colours are as in
    `plot_pareto`. The results need measurements of each problem: those of a run, not the committed ones.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> results = tl.benchmark.run([tl.solvers.Newton()], ["point", "trajectory"], count=4, quick=True)
    >>> figure = plots.plot_profile(results)
    """
    sets, table = results.feasible_sets, results.each_problem()
    table = table[table["problem_set"].isin(sets)]
    # Of a solver with several policies its own, which is the first; only entries that took part in all sets.
    table = table[table["policy"] == table.groupby(["label", "problem_set"])["policy"].transform("first")]
    entries = table.groupby("label", sort=False)
    table = table[entries["call_s"].transform("any") & (entries["problem_set"].transform("nunique") == len(sets))]
    if table.empty:
        raise InputError("no answers in these results that could be drawn")
    first = table.drop_duplicates("label")
    kinds = {
        label: kind(solver, setting)
        for label, solver, setting in zip(first["label"], first["solver"], first["setting"], strict=True)
    }
    error = table[["error", "violation"]].max(axis=1, skipna=False)  # NaN without an answer
    wide = table.assign(solved=error <= EXACT_N).pivot(
        index=["problem_set", "problem"], columns="label", values=["call_s", "solved"]
    )
    ratios = performance_ratios(wide["call_s"].astype(float), wide["solved"].astype(bool))
    names = {label: short_name(label) for label in kinds}
    fastest = {label: 100.0 * float(np.mean(ratios[label] == 1.0)) for label in kinds}
    first = max(fastest, key=lambda label: fastest[label])
    with new_figure((8.0, 4.6)) as figure:
        axes = figure.subplots()
        named = _named(kinds, lambda label: names[label].partition(",")[0], kinds.__getitem__)
        for label in (*(label for label in kinds if label not in named), *named):
            own = np.sort(ratios[label].dropna())
            if not own.size:
                continue
            reached = own[np.isfinite(own)]
            x = np.concatenate([[1.0], reached, [MAX_RATIO]])
            y = np.append(np.arange(len(reached) + 1), len(reached)) / len(own)
            look = curve_look(named.index(label)) if label in named else {"color": UNNAMED[0]}
            axes.step(x, y, where="post", label=names[label] if label in named else None, **look)
        if len(named) < len(kinds):
            axes.plot([], [], color=UNNAMED[0], label="other solvers")
        axes.set(xscale="log", xlim=(1, MAX_RATIO), ylim=(0, 1.03), xlabel="time / fastest time")
        axes.set(
            ylabel="share of problems",
            title=f"{names[first]} is fastest on {fastest[first]:.0f} % of the problems",
        )
        axes.grid()
        figure.legend(loc="outside right upper")
    return figure


def _named(entries: Iterable[T], name: Callable[[T], str], look: Callable[[T], str]) -> list[T]:
    """Return the entries that have names and colours: all of few, else newton, those of one's own and `RIVALS`."""
    every = list(entries)
    if len({name(entry) for entry in every}) <= MAX_NAMED:
        return every
    return [entry for entry in every if look(entry) in ("own", "newton") or name(entry) in RIVALS]


def performance_ratios(seconds: pandas.DataFrame, solved: pandas.DataFrame) -> pandas.DataFrame:
    """Return how much slower each entry is than the fastest that solved the same problem.

    Both tables have a row for each problem and a column for each entry; the time is NaN where an entry did not try
    a problem, the ratio infinite where it failed. Problems that no entry solved are left out.

    Source: Dolan and Moré, "Benchmarking optimization software with performance profiles", 2002.
    """
    best = seconds.where(solved).min(axis=1)
    ratios = seconds.where(solved | seconds.isna(), np.inf).div(best, axis=0)
    return ratios[best.notna()]
