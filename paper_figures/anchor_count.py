"""What the number of modules buys: the figure, and the numbers behind its curves. ``anchor_count.py [FILE]``."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from tensionlab.experiments.anchor_count import MEASURE, sweep_published, sweep_room
from tensionlab.plots import plot_anchor_count

FORCES = (0.5, 1.0, 1.5, 2.0, 3.0)
"""In N, for the table."""


def main() -> None:
    """Sweep, draw the figure and print the numbers behind its curves."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out") / "anchor-count.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    room = sweep_room()
    plot_anchor_count(sweep_published(), room, path)
    print("Share of the room in which so many newtons can be rendered in every direction:")
    print(f"{'':30s}" + "".join(f"{force:8.1f} N" for force in FORCES))
    for rig in room["rig"].to_numpy():
        values = np.nan_to_num(room[MEASURE].sel(rig=rig).to_numpy())
        print(f"{rig:30s}" + "".join(f"{100 * (values >= force).mean():8.1f} %" for force in FORCES))
    print(f"figure: {path}")


if __name__ == "__main__":
    main()
