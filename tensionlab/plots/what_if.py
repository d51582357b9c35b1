"""What part of the error comes from where: many simulated rigs, of which one thing differs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.plots.house import BLUE, GREEN, GREY, ORANGE, RED, add_legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tensionlab.experiments.published import Published
    from tensionlab.experiments.trials import Trial, Trials

QUESTIONS = {
    "preset": ("the whole rig", "#000000"),
    "error": ("one error alone", ORANGE),
    "solver": ("another solver", BLUE),
    "side": ("another side of the triangle", GREEN),
    "calibration": ("after calibration, held out", RED),
}
"""What each question is called, and its colour."""
PANELS = (
    ("angle", "angle_mean", "mean angle error (°)"),
    ("vector", "magnitude_error_mean", "mean length of the error vector (N)"),
    ("magnitude", "magnitude_mean", "mean size of the measured force (N)"),
)
"""Column of the trials, name of the published value, label."""
TAILS = (0.1, 0.9)
"""Quantiles over the rigs, between which a line is drawn."""


def plot_what_if(trials: Trials, published: Published, path: str | Path) -> None:
    """Draw what is measured where one thing is different: over the rigs, the median and 10 to 90 %.

    A line each choice, in groups of what differs; dotted, what the publication measured on its rig.
    """
    groups = {question: trials.of(question) for question in QUESTIONS if trials.of(question)}
    places, heads, height = {}, {}, 0.0
    for question, choices in groups.items():
        heads[question] = height
        places[question] = {choice: height + 1.0 + line for line, choice in enumerate(choices)}
        height += len(choices) + 1.6
    with new_figure(path, (10.5, 1.3 + 0.2 * height)) as figure:
        panels: Any = figure.subplots(1, len(PANELS), sharey=True)
        for axes, (column, name, label) in zip(panels, PANELS, strict=True):
            for question, choices in groups.items():
                for choice, rows in choices.items():
                    _draw_rigs(axes, rows, column, places[question][choice], QUESTIONS[question][1])
            value = published.results[name].value
            axes.axvline(value, color=GREY, linewidth=1.2, linestyle=":", zorder=1)
            axes.set(xlabel=label, ylim=(height - 1.0, -0.8))
            if column != "magnitude":
                axes.set_xlim(0, None)
            axes.tick_params(axis="y", length=0)
            axes.spines["left"].set_visible(False)
            axes.grid(axis="x")
        ticks = [(place, choice) for each in places.values() for choice, place in each.items()]
        panels[0].set_yticks(*zip(*ticks, strict=True))
        for question, place in heads.items():
            title, colour = QUESTIONS[question]
            where: Any = ("axes fraction", "data")
            panels[0].annotate(title, (0, place), xycoords=where, va="center", color=colour, fontweight="bold")
        rigs = len({row.seed for row in trials.rows})
        figure.suptitle(f"Simulated validations of up to {rigs} rigs", fontsize="medium", fontweight="bold")
        dot = {"marker": "o", "markersize": 5, "markevery": [0]}
        add_legend(figure, 2, [
            ("median of the rigs, 10 to 90 %", {"color": "#000000", **dot}),
            ("published, one rig", {"color": GREY, "linestyle": ":"}),
        ])  # fmt: skip


def _draw_rigs(axes: Axes, rows: list[Trial], column: str, place: float, colour: str) -> None:
    values = np.array([getattr(row, column) for row in rows])
    low, middle, high = np.quantile(values, [TAILS[0], 0.5, TAILS[1]])
    axes.plot([low, high], [place, place], color=colour, linewidth=1.6)
    axes.plot(middle, place, marker="o", markersize=5, color=colour, clip_on=False, zorder=3)
