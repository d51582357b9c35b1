"""Figure of a validation: desired and measured forces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.model.files import rig_from_toml
from tensionlab.plots.style import Entry, add_legend, new_figure
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, RED
from tensionlab.validation.report import ValidationResult, make_recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tensionlab.validation.data_tables import Recording


# Axes of each view, and its name; Y is up. From above, z points towards the viewer's feet.
VIEWS = {(0, 1): "from the front (along −z)", (0, 2): "from above (along −y)"}
DESIRED: Entry = ("desired force", {"color": BLUE, "marker": "o", "fillstyle": "none", "ls": ""})
FAR_ALPHA = 0.35  # opacity of what lies on the far side


def plot_forces(recording: Recording) -> Figure:
    """Draw the desired and the measured forces of a recording of a validation, from the front and from above.

    Blue circles are desired forces, red lines go from there to the measured ones. Those on the far side are pale.

    Examples
    --------
    >>> from tensionlab import datasets, plots
    >>> figure = plots.plot_forces(datasets.load("recordings/paper-like-simulated"))
    """
    reach = 1.05 * float(np.abs([recording.desired, recording.measured]).max())
    with new_figure((9.0, 5.2)) as figure:
        panels: Any = figure.subplots(1, 2)
        for axes, view in zip(panels, VIEWS, strict=True):
            draw_forces(axes, recording.desired, recording.measured, view)
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
            if view == (0, 2):
                axes.invert_yaxis()
        figure.suptitle(recording.title, fontsize="medium", fontweight="bold")
        add_legend(figure, 3, [
            DESIRED,
            ("error: from there to the measured force", {"color": RED}),
            ("pale: on the far side", {"color": RED, "alpha": FAR_ALPHA}),
        ])  # fmt: skip
    return figure


def draw_forces(axes: Any, desired: Floats, rendered: Floats, view: tuple[int, int]) -> None:
    """Draw desired forces (k, d) and their errors, seen along the third axis; NaN is no error."""
    near = np.full(len(desired), True) if desired.shape[1] == 2 else desired[:, 3 - sum(view)] >= -1e-9
    for half, alpha in ((~near, FAR_ALPHA), (near, 1.0)):
        start, end = desired[half][:, view], rendered[half][:, view]
        lines = np.stack([start, end, np.full_like(end, np.nan)], axis=1)
        axes.plot(*lines.reshape(-1, 2).T, color=RED, linewidth=1.1, alpha=alpha, zorder=3)
        axes.plot(
            *start.T, linestyle="", marker="o", markersize=4.5, fillstyle="none", color=BLUE, markeredgewidth=1.0,
            alpha=alpha, zorder=4,
        )  # fmt: skip
    axes.set(aspect="equal", xlabel=f"{'xyz'[view[0]]} (N)", ylabel=f"{'xyz'[view[1]]} (N)")
    if desired.shape[1] == 3:
        axes.set_title(VIEWS[view])
    axes.grid()


def plot_validation(result: ValidationResult) -> Figure:
    """Draw the forces of a validation, aligned as published, with `plot_forces`."""
    rig = rig_from_toml(result.setup["rig"], "rig of the setup")
    return plot_forces(make_recording(result, rig, "", {}))
