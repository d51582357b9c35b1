"""Every figure and table: the data it is drawn from, and the function that draws it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import concepts
import numpy as np
import portraits
import tables

import tensionlab as tl
from paper_figures import anchor_count, brake_maps
from paper_figures.jitter import load_jitter, plot_jitter
from paper_figures.scenario_layouts import plot_scenario_layouts
from paper_figures.validation_figures import plot_error_sphere, plot_what_if
from tensionlab import plots
from tensionlab.scenarios import SCENARIOS, load_scenario
from tensionlab.workspace import Grid

FIGURE = (".pdf", ".png")
TABLE = (".md", ".tex")
PAGE = (".png",)  # of a figure that only pages of the documentation show
PUBLISHED = "published/bartels2026-validation"
RECORDING = "recordings/paper-like-simulated"
TRIALS = "what-if/paper-like-simulated"
PROPOSALS = (
    "These layouts are proposals of this project. The paper says only that the materials layout is "
    "grounded and that the others mix body and room modules."
)
DIGITS = 6  # swept values are rounded to so many, so that no processor's last digit is seen in a figure


@dataclass(frozen=True)
class Drawing:
    """Data -> figure or table: `load` takes the folder of the data sets, `draw` what it returns.

    `sources` are the files with its data and the code that draws it; if one changes, the figure is stale.
    """

    load: Callable[[Path], Any]
    draw: Callable[[Any], Any]
    sources: tuple[str, ...]
    suffixes: tuple[str, ...] = FIGURE


def load_all(*names: str) -> Callable[[Path], list[Any]]:
    """Return a function that loads these data sets together."""
    return lambda folder: [tl.datasets.load(name, folder) for name in names]


def rounded(swept: Any) -> Any:
    """Return the sweep with rounded values."""
    for values in swept.data_vars.values():
        values.data = np.round(values.data, DIGITS)
    return swept


@cache
def sweeps_of_modules(folder: Path) -> Any:
    """Sweep published rigs, and rigs of three to eight modules in a room."""
    return [rounded(each) for each in anchor_count.sweep_published()], rounded(anchor_count.sweep_room())


def sweep_of_rooms(folder: Path) -> Any:
    """Sweep an upright slice through home of the validation's rig (sides 1.0 and 0.3 m) and of seven modules."""
    names = ("bartels2026-validation", "bartels2026-validation-0.3m", "seven-modules")
    grid = Grid(np.linspace(-1.5, 1.5, 301), np.linspace(0.0, 2.4, 193), np.array([0.0]))
    rigs = [tl.datasets.load(f"rigs/{name}", folder) for name in names]
    return rounded(tl.sweep(rigs, grid, ["capacity-margin", "tension-factor"]))


def layouts_of_scenarios(folder: Path) -> Any:
    """Load the five scenarios of the package."""
    return [load_scenario(name) for name in SCENARIOS]


def published_and_simulated(data: list[Any]) -> tables.Table:
    """Return the table of what the publication measured, beside one simulated rig and many."""
    published, recording, trials = data
    alike = (trials["question"] == "preset") & (trials["choice"] == "paper-like")
    return tables.published_and_simulated(published, recording, trials[alike])


PLOTS, HERE = "tensionlab/plots/", "paper_figures/"
CONCEPTS = (HERE + "concepts.py", HERE + "portraits.py")
DRAWINGS = {
    "forces": Drawing(
        load_all(RECORDING), lambda data: plots.plot_forces(*data),
        (PLOTS + "validation.py", f"datasets/{RECORDING}.*"),
    ),
    "error-sphere": Drawing(
        load_all(RECORDING, "rigs/bartels2026-validation"), lambda data: plot_error_sphere(*data),
        (HERE + "validation_figures.py", f"datasets/{RECORDING}.*", "datasets/rigs/bartels2026-validation.toml"),
    ),
    "published": Drawing(
        load_all(PUBLISHED, RECORDING, TRIALS), published_and_simulated,
        (HERE + "tables.py", *(f"datasets/{name}.*" for name in (PUBLISHED, RECORDING, TRIALS))), TABLE,
    ),
    "what-if": Drawing(
        load_all(TRIALS, PUBLISHED), lambda data: plot_what_if(*data),
        (HERE + "validation_figures.py", f"datasets/{TRIALS}.*", f"datasets/{PUBLISHED}.*"),
    ),
    "time-accuracy": Drawing(
        load_all("benchmarks/results"), lambda data: plots.plot_pareto(*data),
        (PLOTS + "benchmark.py", "datasets/benchmarks/results.*"),
    ),
    "jitter": Drawing(
        load_jitter, plot_jitter, (HERE + "jitter.py", "datasets/benchmarks/jitter.json"), PAGE
    ),
    "anchor-count": Drawing(
        sweeps_of_modules, lambda data: anchor_count.plot_anchor_count(*data),
        (HERE + "anchor_count.py", PLOTS + "workspace.py"),
    ),
    "anchor-count-shares": Drawing(
        sweeps_of_modules, lambda data: tables.shares_of_room(data[1]),
        (HERE + "anchor_count.py", HERE + "tables.py"), TABLE,
    ),
    "scenario-layouts": Drawing(
        layouts_of_scenarios, lambda data: plot_scenario_layouts(data, PROPOSALS),
        (HERE + "scenario_layouts.py", PLOTS + "scene.py", "tensionlab/scenarios/files/*.toml"),
    ),
    "workspace": Drawing(sweep_of_rooms, plots.plot_slices, (PLOTS + "workspace.py", "datasets/rigs/*.toml")),
    "wrench-set": Drawing(lambda _: concepts.wrench_set(), concepts.draw_wrench_set, CONCEPTS, PAGE),
    "policies": Drawing(lambda _: concepts.policies(), concepts.draw_policies, CONCEPTS, PAGE),
    "brake-cones": Drawing(lambda _: None, concepts.draw_brake_cones, CONCEPTS, PAGE),
    "brake-maps": Drawing(
        lambda _: concepts.brake_maps(), lambda found: brake_maps.plot_brake_maps(*found),
        (HERE + "brake_maps.py", "tensionlab/scenarios/files/materials.toml"), PAGE,
    ),
    "stiffness": Drawing(lambda _: concepts.stiffness_bounds(), concepts.draw_stiffness_bounds, CONCEPTS, PAGE),
    "wall-stiffness": Drawing(lambda _: concepts.wall_stiffness(), concepts.draw_wall_stiffness, CONCEPTS, PAGE),
    "pulleys": Drawing(lambda _: concepts.pulley_errors(), concepts.draw_pulley_errors, CONCEPTS, PAGE),
    "module-states": Drawing(
        lambda _: concepts.module_states(), concepts.draw_module_states, CONCEPTS, (".svg",)
    ),
    **{
        f"solver-{name.replace(':', '-')}": Drawing(
            lambda _, name=name: portraits.portrait(name), portraits.draw_portrait, (HERE + "portraits.py",), PAGE
        )
        for name in portraits.PORTRAYED
    },
}  # fmt: skip  # by the name of the file, without its suffix
