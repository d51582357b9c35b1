"""What was on and off while a scenario was played: brakes, and what modules render by themselves."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tensionlab.plots.style import GREEN, legend_beside

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tensionlab.scenarios.play import ScenarioResult

CARRIED = 1.0
"""A pawl is in where the cable pulls by so many N harder than its motor says."""
LIFTING = 0.3
"""And for so long after its brake was asked for, in s."""


class Ribbon(NamedTuple):
    """When was something so, (K,), of the kinds in `RIBBONS`?"""

    kind: str
    on: NDArray[np.bool_]


RIBBONS = {
    "brake": ("brake asked for", "#A8D8C8"),
    "pawl": ("its pawl holds the cable", GREEN),
    "alone": ("a spring or a vibration on the module", "#CC79A7"),
}
"""What ribbons mean, and their colours."""


def ribbons(played: ScenarioResult) -> dict[str, list[Ribbon]]:
    """Which ribbons does the picture need, by the name of their row?"""
    run, carried = played.run, pawls(played)
    alone: NDArray[np.bool_] = np.asarray(np.isfinite(run.impedances).any(axis=2))
    found = {}
    for index, module in enumerate(run.rig.modules):
        if run.commanded_brakes[:, index].any():
            found[f"{module.name}, brake"] = [
                Ribbon("brake", run.commanded_brakes[:, index]),
                Ribbon("pawl", carried[:, index]),
            ]
        if alone[:, index].any():
            found[f"{module.name}, by itself"] = [Ribbon("alone", alone[:, index])]
    return found


def draw_ribbons(axes: Axes, played: ScenarioResult, rows: dict[str, list[Ribbon]]) -> None:
    """Draw a row for each, and say what its colours mean."""
    used: dict[str, None] = {}
    period = 1.0 / played.run.setup.rate
    for row, each in enumerate(rows.values()):
        axes.axhspan(row - 0.4, row + 0.4, color="#F1F1F1", zorder=0)
        for kind, on in each:
            if on.any():
                used[kind] = None
                edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(int)))
                begins, ends = played.run.time[edges[::2]], played.run.time[edges[1::2] - 1] + period
                spans = list(zip(begins, ends - begins, strict=True))
                half = 0.4 if kind != "pawl" else 0.22
                axes.broken_barh(spans, (row - half, 2 * half), color=RIBBONS[kind][1], linewidth=0.0)
    axes.set_yticks(np.arange(len(rows)), list(rows))
    axes.tick_params(axis="y", length=0, labelsize=8)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.spines["left"].set_visible(False)
    legend_beside(axes, [(RIBBONS[kind][0], {"color": RIBBONS[kind][1], "linewidth": 6}) for kind in used])


def pawls(played: ScenarioResult) -> NDArray[np.bool_]:
    """In which cycles (K, m) did a pawl carry a cable? Only a simulated person knows; else in none."""
    run, felt = played.run, played.person
    found = np.zeros(run.commanded_brakes.shape, dtype=bool)
    if felt is None:
        return found
    for index in range(run.rig.m):
        really = np.interp(run.time, felt.time, felt.tensions[:, index])
        asked = run.time[run.commanded_brakes[:, index]]
        if asked.size:
            latest = np.searchsorted(asked, run.time, side="right") - 1
            soon = (latest >= 0) & (run.time - asked[np.maximum(latest, 0)] <= LIFTING)
            found[:, index] = soon & (really > np.nan_to_num(run.measured[:, index]) + CARRIED)
    return found
