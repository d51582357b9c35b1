"""Pictures of results, always to a file. The only importer of matplotlib; nothing is solved while drawing."""

from tensionlab.plots.bench import plot_accuracy, plot_continuity, plot_profile, plot_worst
from tensionlab.plots.comparison import plot_comparison
from tensionlab.plots.house import METADATA
from tensionlab.plots.rig import plot_rig

__all__ = [
    "METADATA",
    "plot_accuracy",
    "plot_comparison",
    "plot_continuity",
    "plot_profile",
    "plot_rig",
    "plot_worst",
]
