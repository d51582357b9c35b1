"""Figures of the validation for the paper: errors by direction, and sources of error."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pandas import DataFrame

from tensionlab.model.rig import Rig
from tensionlab.plots.style import HALO, add_legend, new_figure
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, RED
from tensionlab.validation.data_tables import Recording
from tensionlab.validation.statistics import deviations


def plot_error_sphere(recording: Recording, rig: Rig) -> Any:
    """Draw, for every direction of force, the errors of direction and size of the measured force.

    The sphere of directions is seen from above and from below, in Lambert's projection, which keeps areas: the
    middle is straight up or down, the rim is horizontal. Squares are the directions in which the cables pull.

    Parameters
    ----------
    recording : Recording
        Of a validation.
    rig : Rig
        That was validated.
    """
    found = deviations(recording.desired, recording.measured)
    angle, size = found.angle, found.magnitude - np.linalg.norm(recording.desired, axis=1)
    largest = float(np.abs(size).max())
    looks = (
        (angle, "angle to the desired force (°)", {"cmap": "viridis_r", "vmin": 0.0}),
        (size, "size: measured minus desired (N)", {"cmap": "RdBu_r", "vmin": -largest, "vmax": largest}),
    )
    with new_figure((12.0, 4.4)) as figure:
        panels: Any = figure.subplots(1, 4)
        for pair, (values, label, look) in zip((panels[:2], panels[2:]), looks, strict=True):
            for axes, up, title in zip(pair, (1.0, -1.0), ("forces upwards", "forces downwards"), strict=True):
                dots = _draw_hemisphere(axes, recording.desired, values, up, look)
                _draw_cables(axes, rig, up)
                axes.set_title(title, loc="center")
            figure.colorbar(dots, ax=pair, label=label, orientation="horizontal", shrink=0.6, aspect=30)
        figure.suptitle(recording.title, fontsize="medium", fontweight="bold")
        look = {"color": "white", "markeredgecolor": "black", "marker": "s", "ls": ""}
        add_legend(figure, 1, [("a cable pulls this way", look)])
    return figure


def _on_disc(vectors: Floats, up: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the places (K, 2) of directions on the disc of one hemisphere, and which are on it."""
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    there = up * unit[:, 1] >= -1e-9
    # x to the right; z towards the viewer's feet from above, away from them from below.
    flat = np.stack([unit[:, 0], -up * unit[:, 2]], axis=1)
    return flat[there] / np.sqrt(1.0 + up * unit[there, 1, None]), there


def _draw_hemisphere(axes: Any, vectors: Floats, values: Floats, up: float, look: dict[str, Any]) -> Any:
    """Draw values at directions on one half of the sphere, and return the dots, for the colour bar."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for ring in np.radians([30.0, 60.0, 90.0]):
        axes.plot(*(np.sqrt(2.0) * np.sin(ring / 2) * np.stack([np.cos(turn), np.sin(turn)])),
                  color="#BBBBBB" if ring > 1.5 else "#E4E4E4", linewidth=0.8, zorder=1)  # fmt: skip
    places, there = _on_disc(vectors, up)
    look = {"vmax": float(values.max())} | look
    dots = axes.scatter(*places.T, c=values[there], s=46, linewidths=0, zorder=2, **look)
    axes.set(aspect="equal", xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
    axes.set_axis_off()
    for letter, place in (("x", (1.1, -0.12)), ("z", (0.12, -1.1 * up))):
        axes.text(*place, letter, ha="center", va="center", color="#555555")
    return dots


def _draw_cables(axes: Any, rig: Rig, up: float) -> None:
    """Mark the directions in which the cables pull at home."""
    places, there = _on_disc(rig.cables(rig.home, frames=rig.at_rest).directions, up)
    names = [module.name for module, shown in zip(rig.modules, there, strict=True) if shown]
    axes.plot(*places.T, linestyle="", marker="s", markersize=6, color="white", markeredgecolor="black", zorder=3)
    for name, place in zip(names, places, strict=True):
        away = float(np.linalg.norm(place))
        outward = place / away if away > 0.3 else np.array([-1.0, 1.0]) / np.sqrt(2.0)
        axes.annotate(
            name, place, xytext=1.12 * outward, ha="right" if outward[0] < 0 else "left", va="center", fontsize=8,
            color="#222222", bbox=HALO, zorder=4,
            arrowprops={"arrowstyle": "-", "color": "#444444", "linewidth": 0.7, "shrinkB": 4},
        )  # fmt: skip


QUESTIONS = {
    "preset": ("the whole rig", "#000000"),
    "error": ("one error alone", ORANGE),
    "solver": ("another solver", BLUE),
    "side": ("another side of the triangle", GREEN),
    "calibration": ("after calibration, held out", RED),
}  # heading and colour of each question
# The same solvers on a rig without errors; drawn as rings beside those of the question "solver".
IDEAL = "solver alone"
# Column of the trials, name of the published value, label, range, and the largest difference that nobody sees.
PANELS = (
    ("angle", "angle_mean", "mean angle error (°)", (0.0, 40.0), 0.01),
    ("vector", "magnitude_error_mean", "mean length of the error vector (N)", (0.0, 1.6), 0.001),
)
TAILS = (0.1, 0.9)  # quantiles over the rigs, between which a line is drawn
MAX_NAMED = 3  # of more choices that come out the same, only the first is named


def plot_what_if(trials: DataFrame, published: DataFrame) -> Any:
    """Draw the errors of rigs of which one thing is different: the median and 10 to 90 % over the rigs.

    A line each choice, in groups of what differs; choices that come out the same share one. Dotted: what the
    publication measured on its rig.

    Parameters
    ----------
    trials : DataFrame
        Data set ``what-if/paper-like-simulated``: a row for each question, choice and simulated rig.
    published : DataFrame
        What the publication measured.
    """
    choices = {question: choices_of(trials, question) for question in (*QUESTIONS, IDEAL)}
    groups = {question: grouped(choices[question]) for question in QUESTIONS if choices[question]}
    ideal = choices[IDEAL]
    heads: dict[str, float] = {}
    places: dict[tuple[str, tuple[str, ...]], float] = {}
    height = 0.0
    for question, lines in groups.items():
        heads[question] = height
        places |= {(question, names): height + 1.0 + line for line, names in enumerate(lines)}
        height += len(lines) + 1.6
    with new_figure((9.0, 1.3 + 0.19 * height)) as figure:
        panels: Any = figure.subplots(1, len(PANELS), sharey=True)
        for axes, (column, name, label, span, _) in zip(panels, PANELS, strict=True):
            axes.axvline(published["value"][name], color=GREY, linewidth=1.2, linestyle=":", zorder=1)
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
            panels[0].annotate(
                title, (0, place), xycoords=where, va="center", color=colour, fontweight="bold", bbox=HALO
            )
        rigs = max(len(rows) for lines in groups.values() for rows in lines.values())
        figure.suptitle(finding(choices), fontsize="medium", fontweight="bold")
        dot: dict[str, Any] = {"color": "#000000", "marker": "o", "markersize": 5}
        looks: list[tuple[str, dict[str, Any]]] = [
            (f"median of {rigs} rigs, 10 to 90 %", dot | {"markevery": [0]}),
            ("published, one rig", {"color": GREY, "linestyle": ":"}),
        ]
        if ideal:
            looks.insert(1, ("on a rig without errors", dot | {"linestyle": "", "fillstyle": "none"}))
        add_legend(figure, len(looks), looks)
    return figure


def finding(choices: dict[str, dict[str, DataFrame]]) -> str:
    """Return the title: the angle error without errors of the rig, with them, and after the best calibration."""
    presets, calibrations = choices["preset"], choices["calibration"]
    parts = {"without errors of the rig": presets.get("ideal"), "with them": presets.get("paper-like")}
    parts["after calibration"] = min(calibrations.values(), key=lambda rows: rows["angle"].median(), default=None)
    medians = [f"{rows['angle'].median():.1f}° {word}" for word, rows in parts.items() if rows is not None]
    return f"Mean angle error: {', '.join(medians)}"


def choices_of(trials: DataFrame, question: str) -> dict[str, DataFrame]:
    """Return the rows of a question by choice, in the order of the table."""
    return dict(list(trials[trials["question"] == question].groupby("choice", sort=False)))


def grouped(choices: dict[str, DataFrame]) -> dict[tuple[str, ...], DataFrame]:
    """Return choices with the same outcome on every rig together: their names, with the rows of the first."""
    found: dict[tuple[str, ...], DataFrame] = {}
    for choice, rows in choices.items():
        same = next((names for names, others in found.items() if _equal(rows, others)), None)
        if same is None:
            found[choice,] = rows
        else:  # in the place where they were
            found = {(*names, choice) if names == same else names: others for names, others in found.items()}
    return found


def _equal(rows: DataFrame, others: DataFrame) -> bool:
    return len(rows) == len(others) and all(
        np.allclose(rows[column], others[column], rtol=0.0, atol=unseen) for column, *_, unseen in PANELS
    )


def _label(names: tuple[str, ...]) -> str:
    return ", ".join(names) if len(names) <= MAX_NAMED else f"{names[0]} and {len(names) - 1} others (identical)"


def _draw_rigs(
    axes: Any, rows: DataFrame, column: str, place: float, colour: str, fillstyle: Any = "full"
) -> None:
    """Draw the median of some rigs as a dot on the line of its tails; what is beyond the axis, as its number."""
    low, middle, high = np.quantile(rows[column], [TAILS[0], 0.5, TAILS[1]])
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
