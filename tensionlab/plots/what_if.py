"""What part of the error comes from where: many simulated rigs, of which one thing differs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.plots.style import BLUE, GREEN, GREY, ORANGE, RED, add_legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tensionlab.validation.published import Published
    from tensionlab.validation.trials import Trial, Trials

QUESTIONS = {
    "preset": ("the whole rig", "#000000"),
    "error": ("one error alone", ORANGE),
    "solver": ("another solver", BLUE),
    "side": ("another side of the triangle", GREEN),
    "calibration": ("after calibration, held out", RED),
}
"""What each question is called, and its colour."""
IDEAL = "solver alone"
"""The same solvers on a rig without errors; drawn as rings beside those of the question "solver"."""
PANELS = (
    ("angle", "angle_mean", "mean angle error (°)", (0.0, 40.0), 0.01),
    ("vector", "magnitude_error_mean", "mean length of the error vector (N)", (0.0, 1.6), 0.001),
    ("magnitude", "magnitude_mean", "mean size of the measured force (N)", (1.2, 2.3), 0.001),
)
"""Column of the trials, name of the published value, label, what is drawn, and which differences nobody sees."""
TAILS = (0.1, 0.9)
"""Quantiles over the rigs, between which a line is drawn."""
NAMED = 3
"""Of more choices that come out the same, only the first is named."""


def plot_what_if(trials: Trials, published: Published, path: str | Path) -> None:
    """Draw what is measured where one thing is different: over the rigs, the median and 10 to 90 %.

    A line each choice, in groups of what differs; choices that come out the same share one. Dotted: what the
    publication measured on its rig.
    """
    groups = {question: together(trials.of(question)) for question in QUESTIONS if trials.of(question)}
    ideal = trials.of(IDEAL)
    heads: dict[str, float] = {}
    places: dict[tuple[str, tuple[str, ...]], float] = {}
    height = 0.0
    for question, lines in groups.items():
        heads[question] = height
        places |= {(question, names): height + 1.0 + line for line, names in enumerate(lines)}
        height += len(lines) + 1.6
    with new_figure(path, (11.0, 1.3 + 0.2 * height)) as figure:
        panels: Any = figure.subplots(1, len(PANELS), sharey=True)
        for axes, (column, name, label, span, _) in zip(panels, PANELS, strict=True):
            axes.axvline(published.results[name].value, color=GREY, linewidth=1.2, linestyle=":", zorder=1)
            axes.set(xlabel=label, xlim=span, ylim=(height - 1.0, -0.8))
            axes.tick_params(axis="y", length=0, pad=7)
            axes.spines["left"].set_visible(False)
            axes.grid(axis="x")
            for (question, names), place in places.items():
                colour = QUESTIONS[question][1]
                _draw_rigs(axes, groups[question][names], column, place, colour)
                if question == "solver" and names[0] in ideal:
                    _draw_rigs(axes, ideal[names[0]], column, place, colour, fillstyle="none")
        panels[0].set_yticks(list(places.values()), [_label(names) for _, names in places])
        for question, place in heads.items():
            title, colour = QUESTIONS[question]
            where: Any = ("axes fraction", "data")
            panels[0].annotate(title, (0, place), xycoords=where, va="center", color=colour, fontweight="bold")
        rigs = max(len(rows) for lines in groups.values() for rows in lines.values())
        figure.suptitle(f"Simulated validations of {rigs} rigs", fontsize="medium", fontweight="bold")
        dot: dict[str, Any] = {"color": "#000000", "marker": "o", "markersize": 5}
        looks: list[tuple[str, dict[str, Any]]] = [
            ("median of the rigs, 10 to 90 %", dot | {"markevery": [0]}),
            ("published, one rig", {"color": GREY, "linestyle": ":"}),
        ]
        if ideal:
            looks.insert(1, ("on a rig without errors", dot | {"linestyle": "", "fillstyle": "none"}))
        add_legend(figure, len(looks), looks)


def together(choices: dict[str, list[Trial]]) -> dict[tuple[str, ...], list[Trial]]:
    """Which choices come out the same on every rig? Their names, with the trials of the first."""
    found: dict[tuple[str, ...], list[Trial]] = {}
    for choice, rows in choices.items():
        same = next((names for names, others in found.items() if _equal(rows, others)), None)
        if same is None:
            found[choice,] = rows
        else:  # in the place where they were
            found = {(*names, choice) if names == same else names: others for names, others in found.items()}
    return found


def _equal(rows: list[Trial], others: list[Trial]) -> bool:
    return len(rows) == len(others) and all(
        abs(getattr(one, column) - getattr(other, column)) <= unseen
        for one, other in zip(rows, others, strict=True)
        for column, *_, unseen in PANELS
    )


def _label(names: tuple[str, ...]) -> str:
    return ", ".join(names) if len(names) <= NAMED else f"{names[0]}, {len(names) - 1} more the same"


def _draw_rigs(
    axes: Axes, rows: list[Trial], column: str, place: float, colour: str, fillstyle: Any = "full"
) -> None:
    """Draw the median of some rigs as a dot on the line of its tails; what is beyond the axis, as its number."""
    values = np.array([getattr(row, column) for row in rows])
    low, middle, high = np.quantile(values, [TAILS[0], 0.5, TAILS[1]])
    left, right = axes.get_xlim()
    if not left <= middle <= right:
        end, text, side = (
            (right, f"{middle:.3g} →", "right") if middle > right else (left, f"← {middle:.3g}", "left")
        )
        if fillstyle == "full":
            axes.annotate(text, (end, place), ha=side, va="center", fontsize=8, color=colour)
        return
    axes.plot([low, high], [place, place], color=colour, linewidth=1.6)
    axes.plot(middle, place, marker="o", markersize=5, color=colour, fillstyle=fillstyle, clip_on=False, zorder=3)
