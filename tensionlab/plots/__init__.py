"""Figures of results: functions that take a result and return a Matplotlib Figure, without solving anything."""

from tensionlab.plots.allocation import plot_allocation
from tensionlab.plots.benchmark import plot_accuracy, plot_continuity, plot_pareto, plot_profile, plot_worst
from tensionlab.plots.certified import plot_certified
from tensionlab.plots.comparison import plot_comparison
from tensionlab.plots.rig import plot_brake_maps, plot_rig
from tensionlab.plots.run import plot_run
from tensionlab.plots.scenario import plot_scenario, plot_scenario_layouts
from tensionlab.plots.style import METADATA, save_figure, styled
from tensionlab.plots.validation import plot_error_sphere, plot_forces, plot_what_if
from tensionlab.plots.volume import plot_front, plot_layouts, plot_search, plot_volume
from tensionlab.plots.workspace import plot_anchor_count, plot_metrics, plot_shares, plot_slices

__all__ = [
    "METADATA",
    "plot_accuracy",
    "plot_allocation",
    "plot_anchor_count",
    "plot_brake_maps",
    "plot_certified",
    "plot_comparison",
    "plot_continuity",
    "plot_error_sphere",
    "plot_forces",
    "plot_front",
    "plot_layouts",
    "plot_metrics",
    "plot_pareto",
    "plot_profile",
    "plot_rig",
    "plot_run",
    "plot_scenario",
    "plot_scenario_layouts",
    "plot_search",
    "plot_shares",
    "plot_slices",
    "plot_volume",
    "plot_what_if",
    "plot_worst",
    "save_figure",
    "styled",
]


def __dir__() -> list[str]:
    return sorted(__all__)
