"""Figure of a validation: desired and measured forces."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.model.files import rig_from_toml
from tensionlab.plots.style import add_legend, new_figure
from tensionlab.support.colours import BLUE, RED
from tensionlab.validation.report import ValidationResult, make_recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tensionlab.validation.data_tables import Recording


# Axes of each view, and what it is called; Y is up.
VIEWS = (((0, 1), "from the front (along −z)"), ((0, 2), "from above (along −y)"))
FAR_ALPHA = 0.35  # opacity of what lies on the far side


def plot_forces(recording: Recording) -> Figure:
    """Draw the desired forces, and what the sensor measured, from the front and from above.

    Blue circles: desired forces. Red lines: from there to the measured force. What lies on the far side is pale.

    Parameters
    ----------
    recording : Recording
        Of a validation.

    Examples
    --------
    >>> from tensionlab import datasets, plots
    >>> figure = plots.plot_forces(datasets.load("recordings/paper-like-simulated"))
    """
    reach = 1.05 * float(np.abs([recording.desired, recording.measured]).max())
    with new_figure((9.0, 5.2)) as figure:
        panels: Any = figure.subplots(1, 2)
        for axes, (view, title) in zip(panels, VIEWS, strict=True):
            desired, measured = recording.desired[:, view], recording.measured[:, view]
            near = recording.desired[:, 3 - sum(view)] >= -1e-9
            for half, alpha in ((~near, FAR_ALPHA), (near, 1.0)):
                lines = np.stack([desired[half], measured[half], np.full_like(measured[half], np.nan)], axis=1)
                axes.plot(*lines.reshape(-1, 2).T, color=RED, linewidth=1.1, alpha=alpha, zorder=3)
                axes.plot(
                    *desired[half].T, linestyle="", marker="o", markersize=4.5, fillstyle="none", color=BLUE,
                    markeredgewidth=1.0, alpha=alpha, zorder=4,
                )  # fmt: skip
            axes.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), title=title)
            axes.set(xlabel=f"{'xyz'[view[0]]} (N)", ylabel=f"{'xyz'[view[1]]} (N)")
            axes.grid()
            if view == (0, 2):
                axes.invert_yaxis()  # seen from above, x points right and z towards the viewer's feet
        figure.suptitle(recording.title, fontsize="medium", fontweight="bold")
        add_legend(figure, 3, [
            ("desired force", {"color": BLUE, "marker": "o", "fillstyle": "none", "ls": ""}),
            ("error: from there to the measured force", {"color": RED}),
            ("pale: on the far side", {"color": RED, "alpha": FAR_ALPHA}),
        ])  # fmt: skip
    return figure


def plot_validation(result: ValidationResult) -> Figure:
    """Draw the forces of a validation, aligned as published, with `plot_forces`."""
    rig = rig_from_toml(result.setup["rig"], "rig of the setup")
    return plot_forces(make_recording(result, rig, "", {}))
