"""Options that say where a rig is evaluated: ``--box``, ``--step`` and ``--rotations``."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer

from tensionlab.cli.common import options
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_count
from tensionlab.workspace.orientations import parse_rotations

STEPS = 40  # number of steps along the longest edge of the box, if no step is given

Box = Annotated[
    str | None,
    typer.Option(
        metavar="X0 X1 Y0 Y1 Z0 Z1",
        help="Box of positions in m; Z0 = Z1 is a plane. Left out: the box around all anchors and homes.",
    ),
]
Step = Annotated[
    str | None,
    typer.Option(
        metavar="STEP",
        help="Distance between positions in m, of cells their longest edge: one, or one for each axis. "
        f"Left out: {STEPS} steps along the longest edge of the box.",
    ),
]
Rotations = Annotated[
    str | None,
    typer.Option(
        metavar="SET",
        help="Orientations at every position of the box, in degrees: cone:10, how far the axis that points "
        "up is tilted; rpy:-10..10,0,-30..30, roll, pitch and yaw about x, y and z; in the plane "
        "angle:-30..30; each with :STEP, 5 if left out. Or a file (.csv): rx, ry, rz, axis times angle, rad.",
        show_default=False,
    ),
]
Scheduler = Annotated[
    str | None, typer.Option(help="Evaluate on a Dask cluster, tcp://HOST:PORT.", show_default=False)
]


def parse_region(rigs: list[Rig], box: str | None, step: str | None) -> tuple[Floats, Floats]:
    """Return where the box starts and ends along each axis, (d, 2), and its step: one, or one for each axis."""
    dimension = rigs[0].dimension
    if box is None:
        points = np.concatenate([[rig.home, *rig.anchors] for rig in rigs if rig.dimension == dimension])
        ends = np.stack([points.min(axis=0), points.max(axis=0)], axis=-1)
    else:
        numbers = options.parse_numbers("--box", box)
        if len(numbers) != 2 * dimension:
            names = " ".join(f"{axis}0 {axis}1" for axis in "xyz"[:dimension])
            raise typer.BadParameter(
                f"--box has {format_count(len(numbers), 'number')}; {rigs[0].name} needs {2 * dimension}: {names}"
            )
        ends = np.array(numbers).reshape(dimension, 2)
    if step is None:
        return ends, np.array(float(np.ptp(ends, axis=1).max()) / STEPS or 1.0)
    steps = np.array(options.parse_numbers("--step", step))
    return ends, steps[0] if len(steps) == 1 else steps


def parse_orientations(rig: Rig, rotations: str | None) -> Floats | None:
    """Return the orientations at every position, if there are any."""
    up = rig.upward if rig.up else np.eye(rig.dimension)[-1]
    return None if rotations is None else parse_rotations(rotations, rig.dimension, up)
