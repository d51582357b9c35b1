"""Figures of a validation, its desired and measured forces, and of a characterisation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.model.files import rig_from_toml
from tensionlab.model.wall_stiffness import HAND_DAMPING, stiffness_bound
from tensionlab.plots.style import Entry, add_legend, legend_beside, new_figure
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import AXIS_COLOURS, BLUE, GREY, RED
from tensionlab.validation import characterisation_report as reports
from tensionlab.validation.characterisation import Characterisation
from tensionlab.validation.measurements import HALF_POWER
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


def plot_characterisation(result: Characterisation) -> Figure:
    """Draw a characterisation: steps, gains over frequency, and the region of stable walls.

    Examples
    --------
    >>> import tensionlab as tl
    >>> from tensionlab import plots
    >>> from tensionlab.validation.characterisation import CharacterisationPlan, characterise
    >>> result = characterise(CharacterisationPlan(tl.load_rig("tetra-4")))  # doctest: +SKIP
    >>> figure = plots.plot_characterisation(result)  # doctest: +SKIP
    """
    plan = result.plan
    with new_figure((13.0, 4.0)) as figure:
        steps, gains, walls = figure.subplots(1, 3)
        for axis, step in result.steps.items():
            steps.plot(1e3 * step.times, step.force, color=AXIS_COLOURS[axis], label=axis)
        steps.set(title=f"step of {plan.step:g} N", xlabel="time (ms)", ylabel="force (N)", xlim=(0.0, 200.0))
        steps.legend(loc="lower right")
        for axis, response in result.responses.items():
            gains.plot(response.frequencies, response.gains, ".-", color=AXIS_COLOURS[axis], label=f"host, {axis}")
        for module, response in result.vibrations.items():
            gains.plot(response.frequencies, response.gains, ".:", label=f"module {module}")
        gains.axhline(HALF_POWER, color=GREY, linewidth=0.8, label="−3 dB")
        gains.set(title=f"gain of a force of {plan.amplitude:g} N", xlabel="frequency (Hz)", xscale="log")
        gains.legend(loc="lower left", fontsize="small")
        for trial in (trial for trials in result.walls.values() for trial in trials):
            hollow = "none" if trial.added_damping < 0.0 else BLUE
            look = {"marker": "o", "color": BLUE, "mfc": hollow} if trial.stable else {"marker": "x", "color": RED}
            walls.plot(trial.stiffness, trial.damping, linestyle="", **look)
        dampings = np.array(list(result.walls))
        stable = [reports.wall_limits(trials)[0] for trials in result.walls.values()]
        delay = float(np.median(result.round_trips))
        bound = stiffness_bound(delay, 1.0 / plan.rate, HAND_DAMPING, dampings)
        walls.plot(stable, dampings, color=BLUE)
        walls.plot(bound, dampings, color=GREY, linestyle="--")
        title = f"walls along {result.wall_axis}: stable up to {max(stable):.0f} N/m"
        walls.set(title=title, xlabel="stiffness (N/m)", ylabel="damping (N s/m)", xlim=(0.0, 2.0 * max(stable)))
        legend_beside(walls, [
            ("passive", {"marker": "o", "color": BLUE, "ls": ""}),
            ("stable", {"marker": "o", "color": BLUE, "fillstyle": "none", "ls": ""}),
            ("unstable", {"marker": "x", "color": RED, "ls": ""}),
            ("boundary", {"color": BLUE}),
            ("theory without friction", {"color": GREY, "ls": "--"}),
        ])  # fmt: skip
        figure.suptitle(result.title, fontsize="medium", fontweight="bold")
    return figure
