"""Pictures of results, always to a file. The only importer of matplotlib; nothing is solved while drawing."""

from tensionlab.plots.accuracy import plot_summary
from tensionlab.plots.anchor_count import plot_anchor_count
from tensionlab.plots.bench import plot_accuracy, plot_continuity, plot_profile, plot_worst
from tensionlab.plots.comparison import plot_comparison
from tensionlab.plots.forces import plot_error_sphere, plot_forces
from tensionlab.plots.layout import plot_layouts
from tensionlab.plots.rig import plot_rig
from tensionlab.plots.run import plot_run
from tensionlab.plots.scenario_layouts import plot_scenario_layouts
from tensionlab.plots.scenarios import plot_scenario
from tensionlab.plots.style import METADATA
from tensionlab.plots.what_if import plot_what_if
from tensionlab.plots.workspace import plot_measures, plot_shares, plot_slices, plot_volume

__all__ = [
    "METADATA",
    "plot_accuracy",
    "plot_anchor_count",
    "plot_comparison",
    "plot_continuity",
    "plot_error_sphere",
    "plot_forces",
    "plot_layouts",
    "plot_measures",
    "plot_profile",
    "plot_rig",
    "plot_run",
    "plot_scenario",
    "plot_scenario_layouts",
    "plot_shares",
    "plot_slices",
    "plot_summary",
    "plot_volume",
    "plot_what_if",
    "plot_worst",
]
