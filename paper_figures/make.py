"""Draw the figures: ``python paper_figures/make.py [--datasets FOLDER] [--out FOLDER] [NAME ...]``."""

from __future__ import annotations

import argparse
from pathlib import Path

from figures import DRAWINGS

ROOT = Path(__file__).parents[1]


def main() -> None:
    """Load the data of each figure once, and draw it into each of its files."""
    parser = argparse.ArgumentParser(description="Draw the figures of this project from its data sets.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"all, or some of {', '.join(DRAWINGS)}")
    parser.add_argument("--datasets", type=Path, default=ROOT / "datasets", help="where the data are")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures", help="where the files go")
    asked = parser.parse_args()
    for name in asked.names:
        if name not in DRAWINGS:
            parser.error(f"no figure is called {name!r}; there are {', '.join(DRAWINGS)}")
    asked.out.mkdir(parents=True, exist_ok=True)
    for name in asked.names or DRAWINGS:
        drawing = DRAWINGS[name]
        data = drawing.load(asked.datasets)
        for suffix in drawing.suffixes:
            path = asked.out / f"{name}{suffix}"
            drawing.draw(data, path)
            print(path)


if __name__ == "__main__":
    main()
