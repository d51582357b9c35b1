"""``tensionlab trajectory``: whether a rig can carry its platform along a trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tensionlab.benchmark.comparison import compare
from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, option
from tensionlab.support.table import Table, findings_table
from tensionlab.trajectory import inverse_dynamics, read_trajectory
from tensionlab.validation.trajectory_check import WINCH_COLUMNS, check_trajectory


def trajectory(
    rig: options.RigArgument,
    path: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Trajectory: points to go through (.toml), or samples (.csv, .parquet): t, x, y, z.",
        ),
    ],
    payload: Annotated[float, option("KG", "Mass at the platform's reference point.", min=0.0)] = 0.0,
    solvers: Annotated[
        list[str], option("A,B,...", "Solvers to compare, such as newton,polygon.", "--solvers")
    ] = ["newton", "closed-form"],  # noqa: B006 - typer copies it
    gravity: options.Gravity = None,
    frames: options.BodyFrames = None,
    plot: options.Plot = None,
    json: Json = False,
) -> None:
    """Check whether a rig can carry its platform along a trajectory. Exit status 1 where it cannot.

    Checks tensions, the motors' speed at them, and the clearance of cables at each sample; then compares solvers,
    whose tensions over time --plot draws.
    """
    loaded, planned = options.load(rig, frames, None, gravity), read_trajectory(path)
    names = options.parse_names(solvers)
    options.check_solvers(loaded, names, None)
    planned.check_rig(loaded)
    wrenches = inverse_dynamics(loaded, planned, payload)
    findings, winches = check_trajectory(loaded, planned, wrenches)
    passed = all(finding.passed is not False for finding in findings)
    compared = compare(loaded, wrenches, poses=planned, solvers=names)
    with output.ResultWriter(quiet=json) as writer:
        writer.draw(plot, "comparison", compared)
        if json:
            checks = [
                {"check": finding.name, "passed": finding.passed, "finding": finding.text} for finding in findings
            ]
            rows = [dict(zip(WINCH_COLUMNS, row, strict=True)) for row in winches]
            output.print_json(rig=loaded.name, passed=passed, checks=checks, winches=rows, solvers=compared.rows)
        else:
            can = "can" if passed else "cannot"
            title = f"{loaded.name} {can} carry its platform along {path.name}: {repr(planned)[1:-1]}"
            output.print_table(findings_table(title, findings))
            output.print_line()
            output.print_table(Table([*WINCH_COLUMNS.values()], winches, "Each winch with the tensions of newton"))
            output.print_line()
            output.print_table(compared.table())
    raise typer.Exit(0 if passed else 1)
