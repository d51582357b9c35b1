"""``tensionlab allocate``: the tensions for one wrench."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensionlab.cli.common import output

if TYPE_CHECKING:
    from tensionlab.allocation import Allocation
    from tensionlab.model.rig import Rig
    from tensionlab.solvers.base import Status

WORDS = {
    "EXACT": "exact: all limits kept, the wrench rendered",
    "NEAREST": "nearest in {policy}: the wrench is proved out of reach, this is the best substitute",
    "ITERATION_LIMIT": "iteration limit: neither exact nor proved out of reach; try --solver newton",
    "FAILED": "failed: the solver broke",
}
AT_LIMIT = 1e-9
"""N within which a tension counts as at its limit."""


def allocate(
    rig: Annotated[Path, typer.Argument(help="Rig file (TOML).", show_default=False)],
    wrench: Annotated[
        str, typer.Option(metavar="FX FY ...", help="Desired wrench in N (and N·m).", show_default=False)
    ],
    at: Annotated[
        str | None, typer.Option(metavar="X Y Z", help="Position in m; the rig's home if left out.")
    ] = None,
    solver: Annotated[str, typer.Option(help="A name that `tensionlab solvers` lists.")] = "newton",
    nearest: Annotated[
        str | None, typer.Option(help="force, tension or direction; the solver's own if left out.")
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(metavar="T1 T2 ...", help="Tensions in N to stay close to, or: lower, middle. Else 0."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Choose the cable tensions that render one wrench. Exit status 1 where they do not render it exactly.

    Body frames stay at rest, at the origin of the world.
    """
    from tensionlab.allocation import Allocator
    from tensionlab.model.files import load_rig
    from tensionlab.solvers.base import Status

    loaded = load_rig(rig)
    output.check_solvers(loaded, [solver], nearest)
    asked = output.numbers(wrench)
    if len(asked) != loaded.n:
        names = output.components(loaded)
        raise typer.BadParameter(
            f"--wrench has {len(asked)} components; {loaded.name} needs {loaded.n}: {', '.join(names)}"
        )
    position = loaded.home if at is None else output.numbers(at)
    allocator = Allocator(
        loaded.limits,
        solver,
        reference if reference in (None, "lower", "middle") else output.numbers(reference),
        nearest,  # type: ignore[arg-type]  # checked above
    )
    result = allocator(loaded.structure_matrix(position, frames=loaded.at_rest), asked)
    status = Status(int(result.status))
    if json:
        output.print_json(
            {
                "rig": loaded.name,
                "position": position,
                "solver": solver,
                "nearest": allocator.nearest,
                "status": status.name,
                "modules": [module.name for module in loaded.modules],
                "tensions": result.tensions,
                "wrench_desired": asked,
                "wrench_rendered": result.wrench,
                "residual": result.residual,
                "scale": result.scale,
                "iterations": result.iterations,
                "separation": result.separation,
                "failure": result.failures.get(0),
            }
        )
    else:
        _print(loaded, position, asked, result, _verdict(status, allocator.nearest, float(result.scale)))
    raise typer.Exit(0 if status is Status.EXACT else 1)


def _verdict(status: Status, policy: str | None, scale: float) -> str:
    words = WORDS[status.name].format(policy=policy)
    if status.name != "NEAREST" or policy != "direction":
        return words
    if math.isnan(scale):
        return words + "; no part of it keeps the direction, so this is the nearest in force"
    return words + f", {100 * scale:.4g} % of it"


def _print(rig: Rig, position: Any, asked: list[float], result: Allocation, verdict: str) -> None:
    """The tensions beside their limits, then the wrench, then the verdict."""
    console = output.console()
    grid = output.table(f"{rig.name} at {output.vector(position)} m")
    for heading in ("module", "tension N", "lower N", "upper N", ""):
        grid.add_column(heading, justify="left" if heading in ("module", "") else "right", no_wrap=True)
    for module, tension in zip(rig.modules, result.tensions, strict=True):
        at = (
            "at its lower limit"
            if tension <= module.lower + AT_LIMIT
            else "at its upper limit"
            if tension >= module.upper - AT_LIMIT
            else ""
        )
        grid.add_row(module.name, f"{tension:.4f}", f"{module.lower:g}", f"{module.upper:g}", at)
    console.print(grid)
    console.print()
    components = output.table()
    for heading in ("wrench", "desired", "rendered", "difference"):
        components.add_column(heading, justify="left" if heading == "wrench" else "right", no_wrap=True)
    for name, wanted, got in zip(output.components(rig), asked, result.wrench, strict=True):
        components.add_row(
            name, f"{wanted:.4f}", f"{got + 0.0:.4f}".replace("-0.0000", "0.0000"), output.short(wanted - got)
        )
    console.print(components)
    console.print()
    unit = "N" if rig.n == rig.dimension else "(N and N·m together)"
    console.print(f"error {output.short(float(result.residual))} {unit}, {verdict}", soft_wrap=True)
    if reason := result.failures.get(0):
        console.print(reason, soft_wrap=True)
