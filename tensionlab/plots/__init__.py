"""Figures of results: functions that take a result and return a Matplotlib Figure, without solving anything."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tensionlab.errors import InputError
from tensionlab.plots.benchmark import plot_pareto, plot_profile
from tensionlab.plots.comparison import plot_comparison
from tensionlab.plots.layout import plot_front, plot_search
from tensionlab.plots.rig import plot_allocation, plot_rig
from tensionlab.plots.run import plot_run
from tensionlab.plots.scenario import plot_scenario
from tensionlab.plots.style import METADATA, save_figure, styled
from tensionlab.plots.validation import plot_characterisation, plot_forces, plot_validation
from tensionlab.plots.workspace import plot_certified, plot_shares, plot_slices, plot_volume

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "METADATA",
    "plot",
    "plot_allocation",
    "plot_certified",
    "plot_characterisation",
    "plot_comparison",
    "plot_forces",
    "plot_front",
    "plot_pareto",
    "plot_profile",
    "plot_rig",
    "plot_run",
    "plot_scenario",
    "plot_search",
    "plot_shares",
    "plot_slices",
    "plot_volume",
    "save_figure",
    "styled",
]

# Figure of each class, by its name: a figure loads only the room whose result it draws.
PLOTTERS: dict[str, Callable[..., Figure]] = {
    "tensionlab.allocation.Allocation": plot_allocation,
    "tensionlab.benchmark.results.Results": plot_pareto,
    "tensionlab.benchmark.comparison.Comparison": plot_comparison,
    "tensionlab.hardware.log.reader.Run": plot_run,
    "tensionlab.model.rig.Rig": plot_rig,
    "tensionlab.scenarios.play.ScenarioResult": plot_scenario,
    "tensionlab.validation.characterisation.Characterisation": plot_characterisation,
    "tensionlab.validation.data_tables.Recording": plot_forces,
    "tensionlab.validation.report.ValidationResult": plot_validation,
    "tensionlab.workspace.certified.CertifiedWorkspace": plot_certified,
    "tensionlab.workspace.layout.results.Layout": lambda layout, **options: plot_rig(layout.rig, **options),
    "tensionlab.workspace.layout.results.LayoutSearch": plot_front,
}


def plot(result: Any, *context: Any, **options: Any) -> Figure:
    """Draw a rig or a result: an allocation, comparison, benchmark, run, scenario, validation or layout search.

    ``context`` and ``options`` are further arguments of the ``plot_`` function of its class: `plot_allocation`
    takes the rig, too. InputError if there is no figure of such an object.

    Examples
    --------
    >>> import tensionlab as tl
    >>> figure = tl.plot(tl.load_rig("bartels2026-validation"))
    """
    for kind in type(result).__mro__:
        if plotter := PLOTTERS.get(f"{kind.__module__}.{kind.__qualname__}"):
            return plotter(result, *context, **options)
    names = ", ".join(name.rpartition(".")[2] for name in PLOTTERS)
    raise InputError(f"there is no figure of a {type(result).__name__}; tl.plot draws {names}")


def __dir__() -> list[str]:
    return sorted(__all__)
