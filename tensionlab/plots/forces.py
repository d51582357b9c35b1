"""Forces that were felt beside those that were asked for: as vectors, and by direction."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.plots.style import BLUE, HALO, RED, add_legend, new_figure

if TYPE_CHECKING:
    from tensionlab.arrays import Floats
    from tensionlab.model.rig import Rig
    from tensionlab.validation.recordings import Recording

VIEWS = (((0, 1), "from the front (along −z)"), ((0, 2), "from above (along −y)"))
"""Axes of each view, and what it is called; Y is up."""
FAR = 0.35
"""How much of its colour is left of what lies on the far side."""


def plot_forces(recording: Recording, path: str | Path) -> None:
    """Draw the forces asked for, and what the sensor felt instead, from the front and from above.

    Blue circles: forces asked for. Red lines: from there to the force that was felt. What lies on the far side
    is pale.
    """
    reach = 1.05 * float(np.abs([recording.desired, recording.measured]).max())
    with new_figure(path, (9.0, 5.2)) as figure:
        panels: Any = figure.subplots(1, 2)
        for axes, (view, title) in zip(panels, VIEWS, strict=True):
            wanted, felt = recording.desired[:, view], recording.measured[:, view]
            near = recording.desired[:, 3 - sum(view)] >= -1e-9
            for half, alpha in ((~near, FAR), (near, 1.0)):
                lines = np.stack([wanted[half], felt[half], np.full_like(felt[half], np.nan)], axis=1)
                axes.plot(*lines.reshape(-1, 2).T, color=RED, linewidth=1.1, alpha=alpha, zorder=3)
                axes.plot(
                    *wanted[half].T, linestyle="", marker="o", markersize=4.5, fillstyle="none", color=BLUE,
                    markeredgewidth=1.0, alpha=alpha, zorder=4,
                )  # fmt: skip
            axes.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), title=title)
            axes.set(xlabel=f"{'xyz'[view[0]]} (N)", ylabel=f"{'xyz'[view[1]]} (N)")
            axes.grid()
            if view == (0, 2):
                axes.invert_yaxis()  # seen from above, x points right and z towards the viewer's feet
        figure.suptitle(caption(recording), fontsize="medium", fontweight="bold")
        add_legend(figure, 3, [
            ("force asked for", {"color": BLUE, "marker": "o", "fillstyle": "none", "ls": ""}),
            ("error: from there to the force felt", {"color": RED}),
            ("pale: on the far side", {"color": RED, "alpha": FAR}),
        ])  # fmt: skip


def plot_error_sphere(recording: Recording, rig: Rig, path: str | Path) -> None:
    """Draw, for every direction of force, how far off the direction and the size of the felt force are.

    The sphere of directions is seen from above and from below, in Lambert's projection, which keeps areas: the
    middle is straight up or down, the rim is horizontal. Squares are the directions in which the cables pull.
    """
    angle, size = _deviations(recording)
    largest = float(np.abs(size).max())
    looks = (
        (angle, "angle to the force asked for (°)", {"cmap": "viridis_r", "vmin": 0.0}),
        (size, "size: felt minus asked for (N)", {"cmap": "RdBu_r", "vmin": -largest, "vmax": largest}),
    )
    with new_figure(path, (12.0, 4.4)) as figure:
        panels: Any = figure.subplots(1, 4)
        for pair, (values, label, look) in zip((panels[:2], panels[2:]), looks, strict=True):
            for axes, up, title in zip(pair, (1.0, -1.0), ("forces upwards", "forces downwards"), strict=True):
                dots = _draw_hemisphere(axes, recording.desired, values, up, look)
                _draw_cables(axes, rig, up)
                axes.set_title(title, loc="center")
            figure.colorbar(dots, ax=pair, label=label, orientation="horizontal", shrink=0.6, aspect=30)
        figure.suptitle(caption(recording), fontsize="medium", fontweight="bold")
        look = {"color": "white", "markeredgecolor": "black", "marker": "s", "ls": ""}
        add_legend(figure, 1, [("a cable pulls this way", look)])


def caption(recording: Recording) -> str:
    """Which recording is it?"""
    about = recording.manifest["recording"]
    kind = "simulated" if recording.simulated else "measured"
    force = float(np.linalg.norm(recording.desired, axis=1).mean())
    return f"{about['rig']}, {kind}: {len(recording.desired)} forces of {force:.3g} N, solver {about['solver']}"


def _deviations(recording: Recording) -> tuple[Floats, Floats]:
    """By how many degrees, and by how many newtons in size, is each felt force off?"""
    wanted, felt = recording.desired, recording.measured
    across = np.linalg.norm(np.cross(wanted, felt), axis=1)
    angle = np.degrees(np.arctan2(across, np.sum(wanted * felt, axis=1)))
    return angle, np.linalg.norm(felt, axis=1) - np.linalg.norm(wanted, axis=1)


def _on_disc(vectors: Floats, up: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Where on the disc of one hemisphere is each direction, (K, 2); and which are on it?"""
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    there = up * unit[:, 1] >= -1e-9
    # x to the right; z towards the viewer's feet from above, away from them from below.
    flat = np.stack([unit[:, 0], -up * unit[:, 2]], axis=1)
    return flat[there] / np.sqrt(1.0 + up * unit[there, 1, None]), there


def _draw_hemisphere(axes: Any, vectors: Floats, values: Floats, up: float, look: dict[str, Any]) -> Any:
    """Draw values at directions on one half of the sphere. Returns the dots, for the colour bar."""
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
    places, there = _on_disc(rig.directions(rig.home, frames=rig.at_rest), up)
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
