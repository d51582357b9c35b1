"""Draw the figures: ``python paper_figures/make.py [--datasets FOLDER] [--out FOLDER] [NAME ...]``."""

from __future__ import annotations

import argparse
from pathlib import Path

import stamps
from figures import DRAWINGS, TABLE
from tables import write_table

from tensionlab.plots import save_figure

ROOT = Path(__file__).parents[1]
FIGURES = ROOT / "docs" / "figures"


def main() -> None:
    """Load the data of each figure, draw it once, and write it in each of its formats."""
    parser = argparse.ArgumentParser(description="Draw the figures of this project from its data sets.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"all, or some of {', '.join(DRAWINGS)}")
    parser.add_argument("--datasets", type=Path, default=ROOT / "datasets", help="where the data are")
    parser.add_argument("--out", type=Path, default=FIGURES, help="where the files go")
    options = parser.parse_args()
    for name in options.names:
        if name not in DRAWINGS:
            parser.error(f"no figure is called {name!r}; there are {', '.join(DRAWINGS)}")
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.names or DRAWINGS:
        drawing = DRAWINGS[name]
        drawn = drawing.draw(drawing.load(options.datasets))
        write = write_table if drawing.suffixes == TABLE else save_figure
        for suffix in drawing.suffixes:
            path = options.out / f"{name}{suffix}"
            write(drawn, path)
            if options.out == FIGURES:
                found = stamps.stamp(path, (*drawing.sources, *stamps.COMMON))
                stamps.update({f"figures/{path.name}": found})
            print(path)


if __name__ == "__main__":
    main()
