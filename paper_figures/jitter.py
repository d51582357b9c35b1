"""Figure of the control loop's jitter: how late cycles begin, and their work, with and without real time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from tensionlab.plots.style import add_legend, new_figure
from tensionlab.support.colours import BLUE, GREY
from tensionlab.support.formatting import format_duration

LOOKS = {"ordinary": {"color": GREY}, "real-time": {"color": BLUE}}
PANELS = {"start_delays": "cycle begins after its deadline (s)", "compute_times": "work of a cycle (s)"}


def load_jitter(folder: Path) -> dict[str, Any]:
    """Read what ``python -m benchmarks.runner --jitter`` measured."""
    return dict(json.loads((folder / "benchmarks" / "jitter.json").read_text(encoding="utf-8")))


def plot_jitter(found: dict[str, Any]) -> Any:
    """Draw histograms of how late cycles begin, and of their work."""
    edges = 1e-6 * np.array(found["edges_us"])
    with new_figure((10.0, 3.6)) as figure:
        for axes, (name, label) in zip(figure.subplots(1, 2, sharey=True), PANELS.items(), strict=True):
            for scheduling, look in LOOKS.items():
                counts = np.array(found[scheduling][name]["counts"])
                axes.stairs(counts / counts.sum(), edges, linewidth=1.5, **look)
            median, tail, _ = (format_duration(1e-6 * each) for each in found["real-time"][name]["percentiles_us"])
            axes.set(xscale="log", yscale="log", xlabel=label, xlim=(1e-6, 1.0))
            axes.set_title(f"in real time: median {median}, 99.9 % within {tail}", loc="left")
        figure.axes[0].set_ylabel("share of the cycles")
        missed = [
            f"{found[each]['missed']:,} of {found[each]['deadlines']:,} deadlines missed with {each} scheduling"
            for each in LOOKS
        ]
        figure.suptitle(
            f"{', '.join(missed)}\n"
            f"{found['manifest']['processor']}, {found['processors']} processors, load average before the run "
            f"{found['load_average']:g}",
            fontsize="medium",
        )
        add_legend(figure, 2, [(f"{name} scheduling", look) for name, look in LOOKS.items()])
    return figure
