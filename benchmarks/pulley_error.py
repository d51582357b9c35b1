"""What leaving pulleys out costs on the published rig: ``python -m benchmarks.pulley_error``.

Cables of the rig go over pulleys, and the program that runs it takes them for fixed anchors. Forces of 1 N, in
random directions, are rendered at random positions at which every such force can be. The table has the error of
the force for pulleys of several radii, once where the position is tracked and once where it comes from the lengths
of the cables, calibrated at home as on the device; and how far off that position is.

The pulleys swivel about axes at right angles to the cables at home, upright where they can be.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

import tensionlab as tl
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.workspace import capacity_margin

RIG = "bartels2026-validation"
FORCE_N = 1.0
RADII_MM = (2.0, 5.0, 10.0, 20.0, 40.0)
COLUMNS = ("force, tracked (%)", "force, by lengths (%)", "position (mm)")


def over_pulleys(rig: Rig, radius: float) -> Rig:
    """Return the rig with pulleys of a radius in m."""
    modules = []
    for module in rig.modules:
        away = (rig.home - module.anchor) / np.linalg.norm(rig.home - module.anchor)
        across = [axis - (axis @ away) * away for axis in (rig.upward, np.roll(rig.upward, 1))]
        axis = max(across, key=lambda each: float(np.linalg.norm(each)))
        modules.append(replace(module, pulley_radius=radius, pulley_axis=axis))
    return replace(rig, modules=tuple(modules))


def samples(rig: Rig, count: int) -> tuple[Floats, Floats]:
    """Return positions (count, 3) that render every force of `FORCE_N`, and a direction (count, 3) for each."""
    rng = np.random.default_rng(0)
    low, high = rig.anchors.min(axis=0), rig.anchors.max(axis=0)
    position = rng.uniform(low, high, (100 * count, 3))
    within = np.linalg.norm(position[:, None] - rig.anchors, axis=2).min(axis=1) > 0.1
    position = position[within]
    margin = capacity_margin(rig.structure_matrix(position), rig.limits)
    position = position[margin >= FORCE_N][:count]
    direction = rng.normal(size=position.shape)
    return position, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def errors(rig: Rig, radius: float, position: Floats, direction: Floats) -> Floats:
    """Return the columns of `COLUMNS`, (3, B), for pulleys of a radius in m."""
    real = over_pulleys(rig, radius)
    lengths = real.lengths(position) - real.lengths(rig.home) + rig.lengths(rig.home)
    found = rig.forward_kinematics(lengths, position).position
    wanted, truth = FORCE_N * direction, real.structure_matrix(position)
    rows = []
    for believed in (position, found):
        tensions = tl.allocate(rig.structure_matrix(believed), wanted, rig.limits).tensions
        force = np.einsum("bij,bj->bi", truth, tensions)
        rows.append(100.0 * np.linalg.norm(force - wanted, axis=1) / FORCE_N)
    return np.array([*rows, 1e3 * np.linalg.norm(found - position, axis=1)])


def study(count: int) -> tuple[int, dict[float, Floats]]:
    """Return how many positions there are, and the errors for each radius in mm."""
    rig = tl.load_rig(RIG)
    position, direction = samples(rig, count)
    found = {radius: errors(rig, 1e-3 * radius, position, direction) for radius in RADII_MM}
    return len(position), found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5000, help="positions")
    count, found = study(parser.parse_args().count)
    print(f"{count:,} positions, a force of {FORCE_N:g} N at each; median, and below what 95 % are")
    print(f"{'radius':>8}  " + "  ".join(f"{column:>22}" for column in COLUMNS))
    for radius, values in found.items():
        cells = [f"{np.median(row):.2f} ({np.quantile(row, 0.95):.2f})" for row in values]
        print(f"{radius:5g} mm  " + "  ".join(f"{cell:>22}" for cell in cells))


if __name__ == "__main__":
    main()
