"""``tensionlab allocate``: the tensions for one wrench."""

from __future__ import annotations

import math
from typing import Annotated, Any

import typer

from tensionlab.allocation import Allocation, Allocator
from tensionlab.cli.common import options, output
from tensionlab.cli.common.options import At, BodyFrames, Gravity, Policy, RigArgument, Solver
from tensionlab.cli.common.verbs import Json
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.formatting import format_number, format_vector
from tensionlab.support.table import Column, Table

STATUS_TEXTS = {
    "EXACT": "exact: all limits kept, the wrench rendered",
    "NEAREST": "nearest in {policy}: the wrench is certified infeasible, this is the best substitute",
    "UNPROVEN": "unproven: neither exact nor certified infeasible; try --solver newton",
    "FAILED": "failed: the solver broke",
}
REFERENCES = ("lower", "middle")
LIMIT_TOLERANCE_N = 1e-9  # within which a tension counts as at its limit


def allocate(
    rig: RigArgument,
    wrench: Annotated[str, typer.Option(metavar="FX FY ...", help="Desired wrench in N (and N·m).")],
    gravity: Gravity = None,
    frames: BodyFrames = None,
    at: At = None,
    solver: Solver = "newton",
    policy: Policy = None,
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="T1 T2 ...", help="Tensions in N to stay close to, or: lower, middle. Left out: 0 for each."
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Choose the cable tensions that render one wrench. Exit status 1 where they do not render it exactly.

    Where the rig's file or --gravity says so, they hold the weight as well.
    """
    loaded = options.load(rig, frames, wrench, gravity)
    options.check_solvers(loaded, [solver], policy)
    desired = loaded.required.middle(loaded).tolist()
    position = options.parse_position(at, loaded)
    allocator = Allocator(loaded.limits, solver, _reference(loaded, reference), policy)  # type: ignore[arg-type]  # checked
    result = allocator(loaded.structure_matrix(position, frames=loaded.at_rest), desired)
    status = Status(int(result.status))
    if json:
        output.print_json(
            rig=loaded.name,
            position=position,
            solver=solver,
            policy=allocator.policy,
            status=status.name,
            modules=[module.name for module in loaded.modules],
            tensions=result.tensions,
            wrench_desired=desired,
            wrench_rendered=result.wrench,
            **output.fields(result, "residual", "scale", "iterations", "separation"),
            failure=result.failures.get(0),
        )
    else:
        _print(loaded, position, desired, result)
        unit = "N" if loaded.n == loaded.dimension else "(N and N·m together)"
        text = _status_text(status, allocator.policy, float(result.scale))
        output.print_line(f"\nerror {format_number(float(result.residual))} {unit}, {text}")
        if reason := result.failures.get(0):
            output.print_line(reason)
    raise typer.Exit(0 if status is Status.EXACT else 1)


def _status_text(status: Status, policy: str | None, scale: float) -> str:
    text = STATUS_TEXTS[status.name].format(policy=policy)
    if status is not Status.NEAREST or policy != "direction":
        return text
    if math.isnan(scale):
        return text + "; no part of it keeps the direction, so this is the nearest in force"
    return text + f", {100 * scale:.4g} % of it"


def _reference(rig: Rig, text: str | None) -> str | list[float] | None:
    """Return what ``--reference`` says: a name, or a tension for each module."""
    if text is None or text in REFERENCES:
        return text
    if not any(each.isdigit() for each in text):
        names = " or ".join(REFERENCES)
        raise typer.BadParameter(f"--reference is {text!r}; give {names}, or {rig.m} tensions in N")
    tensions = options.parse_numbers("--reference", text)
    options.check_components("--reference", tensions, [module.name for module in rig.modules], rig.name)
    return tensions


def _print(rig: Rig, position: Any, desired: list[float], result: Allocation) -> None:
    """Print the tensions with their limits, then the desired and the rendered wrench."""
    rows = []
    for module, tension in zip(rig.modules, result.tensions, strict=True):
        at = ""
        if tension <= module.lower + LIMIT_TOLERANCE_N:
            at = "at its lower limit"
        elif tension >= module.upper - LIMIT_TOLERANCE_N:
            at = "at its upper limit"
        rows.append((module.name, tension, module.lower, module.upper, at))
    title = f"{rig.name} at {format_vector(position)} m"
    if rig.required.gravity and rig.platform is not None:
        title += f", its weight of {rig.platform.mass:g} kg held as well"
    columns = ["module", Column("tension", "N", ".4f"), Column("lower", "N"), Column("upper", "N"), ""]
    output.print_table(Table(columns, rows, title))
    output.print_line()
    components = (
        (name, one, round(other, 4) + 0.0, one - other)
        for name, one, other in zip(options.wrench_components(rig), desired, result.wrench, strict=True)
    )
    columns = ["wrench", Column("desired", format=".4f"), Column("rendered", format=".4f"),
               Column("difference", format=format_number)]  # fmt: skip
    output.print_table(Table(columns, components))
