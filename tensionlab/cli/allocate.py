"""``tensionlab allocate``: the tensions for one wrench."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from tensionlab.allocation import Allocation, Allocator
from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, option
from tensionlab.model.module import KINDS
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_number, format_vector
from tensionlab.support.table import Column, Table

STATUS_TEXTS = {
    Status.EXACT: "exact: all limits kept, the wrench rendered",
    Status.NEAREST: "nearest in {policy}: the wrench is certified infeasible, this is the best substitute",
    Status.UNPROVEN: "unproven: neither exact nor certified infeasible; try --solver newton",
    Status.FAILED: "failed: the solver raised an error",
}
LIMIT_TOLERANCE_N = 1e-9  # within which a tension counts as at its limit


def allocate(
    rig: options.RigArgument,
    wrench: Annotated[str, option("FX FY ...", "Desired wrench in N (and N·m).")],
    gravity: options.Gravity = None,
    frames: options.BodyFrames = None,
    at: options.At = None,
    rotation: options.Rotation = None,
    solver: options.Solver = "newton",
    policy: options.Policy = None,
    json: Json = False,
) -> None:
    """Choose the cable tensions that render one wrench. Exit status 1 where they do not render it exactly.

    Where the rig's file or --gravity says so, they hold the weight as well.
    """
    loaded = options.load(rig, frames, wrench, gravity)
    options.check_solvers(loaded, [solver], policy)
    position, turn = options.parse_position(at, loaded), options.parse_rotation(rotation, loaded)
    desired = loaded.required.middle(loaded, turn)
    allocator = Allocator(loaded.limits, solver, policy=policy)  # type: ignore[arg-type]  # checked
    result = allocator(loaded.structure_matrix(position, turn, loaded.at_rest), desired)
    status, reason = Status(int(result.status)), result.failures.get(0)
    if json:
        output.print_json(
            rig=loaded.name,
            position=position,
            rotation=loaded.home_orientation if turn is None else turn,
            solver=solver,
            policy=allocator.policy,
            status=status.name,
            modules=[module.name for module in loaded.modules],
            tensions=result.tensions,
            wrench_desired=desired,
            wrench_rendered=result.wrench,
            **output.fields(result, "residual", "scale", "iterations", "separation"),
            failure=reason,
        )
    else:
        text = STATUS_TEXTS[status].format(policy=allocator.policy)
        if status is Status.NEAREST and allocator.policy == "direction":
            scale = float(result.scale)
            text += (
                "; no part of it keeps the direction, so this is the nearest in force"
                if math.isnan(scale)
                else f", {100 * scale:.4g} % of it"
            )
        error = f"error {format_number(float(result.residual))} {KINDS[loaded.kind].wrench_unit}"
        notes = [f"{error}, {text}", *([reason] if reason else [])]
        output.print_table(_tensions(loaded, position, rotation, result))
        output.print_line()
        output.print_table(_wrenches(loaded, desired, result.wrench, notes))
    raise typer.Exit(0 if status is Status.EXACT else 1)


def _tensions(rig: Rig, position: Floats, rotation: str | None, result: Allocation) -> Table:
    rows = []
    for module, tension in zip(rig.modules, result.tensions, strict=True):
        low, high = tension <= module.lower + LIMIT_TOLERANCE_N, tension >= module.upper - LIMIT_TOLERANCE_N
        at = "at its lower limit" if low else "at its upper limit" if high else ""
        rows.append((module.name, tension, module.lower, module.upper, at))
    title = f"{rig.name} at {format_vector(position)} m"
    if rotation is not None:
        title += f", turned by {format_vector(options.parse_numbers('--rotation', rotation))} rad"
    if rig.required.gravity and rig.platform is not None:
        title += f", its weight of {rig.platform.mass:g} kg held as well"
    return Table(
        ["module", Column("tension", "N", ".4f"), Column("lower", "N"), Column("upper", "N"), ""], rows, title
    )


def _wrenches(rig: Rig, desired: Floats, rendered: Floats, notes: list[str]) -> Table:
    rows = zip(options.wrench_components(rig), desired, rendered.round(4) + 0.0, desired - rendered, strict=True)
    columns = ["wrench", Column("desired", format=".4f"), Column("rendered", format=".4f"),
               Column("difference", format=format_number)]  # fmt: skip
    return Table(columns, rows, notes=notes)
