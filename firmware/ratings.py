"""Compute the ratings of motor and driver, and compare the core's estimate of temperatures with random hardware.

Run it from the root of the repository: ``python firmware/ratings.py``. With ``--write`` the figures go to
`ratings.json`, from which ``make generated`` makes the tables in README.md.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TypedDict

sys.path.insert(0, str(Path(__file__).parents[1]))
from firmware.dangers import FIRMWARE, INCLUDES, OPTIONS

FIGURES = FIRMWARE / "ratings.json"
SEEDS = 1000
CLASS_LIMIT_C = 105.0  # class A, the lowest of enamelled wire (IEC 60085)
TOLERANCE_K = 1.0  # by which a winding may be warmer than estimated


class Estimate(TypedDict):
    """What came of random modules: differences in K, temperatures in °C."""

    modules: int
    warmer_than_estimated: float
    winding: float
    housing: float
    driver: float


class Ratings(TypedDict):
    """Ratings by the temperature of the room in °C.

    Currents in A; and for each the seconds that it may be held from cold, after an hour at half the continuous
    current, and after an hour at all of it and a minute's rest.
    """

    continuous: dict[str, float]
    hold: dict[str, dict[str, list[float]]]
    estimate: Estimate


def compile_ratings(folder: Path) -> Path:
    """Compile the program, and return it."""
    program = folder / "ratings"
    words = ["c++", *OPTIONS, *INCLUDES, FIRMWARE / "ratings" / "ratings.cpp", "-o", program]
    subprocess.run([str(word) for word in words], check=True)
    return program


def measure(program: Path, modules: int, factor: float = 1.0) -> Ratings:
    """Run the program; `factor` is that of the resistance from the housing to the room, 1 as it is expected."""
    output = subprocess.run(
        [str(program), str(modules), str(factor)], check=True, capture_output=True, text=True
    ).stdout
    continuous: dict[str, float] = {}
    hold: dict[str, dict[str, list[float]]] = {}
    numbers: list[float] = []
    for line in output.splitlines():
        kind, room, *words = line.split()
        numbers = [float(word) for word in words]
        if kind == "continuous":
            continuous[room] = numbers[0]
        elif kind == "hold":
            hold.setdefault(room, {})[words[0]] = numbers[1:]
    warmer, winding, housing, driver = numbers
    estimate = Estimate(
        modules=modules, warmer_than_estimated=warmer, winding=winding, housing=housing, driver=driver
    )
    return Ratings(continuous=continuous, hold=hold, estimate=estimate)


def main() -> int:
    """Print the ratings; 1 if a winding got warmer than its class allows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"random modules (default: {SEEDS})")
    parser.add_argument("--write", action="store_true", help=f"write the figures to {FIGURES.name}")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        found = measure(compile_ratings(Path(name)), options.seeds)
    text = json.dumps(found, indent=1)
    print(text)
    warmest, colder = found["estimate"]["winding"], found["estimate"]["warmer_than_estimated"]
    if warmest > CLASS_LIMIT_C or colder > TOLERANCE_K:
        print(f"a winding got {warmest:.1f} °C warm, or {colder:.1f} K warmer than estimated")
        return 1
    if options.write:
        FIGURES.write_text(text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
