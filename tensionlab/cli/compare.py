"""``tensionlab compare``: every solver on the same forces."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.score_table import Column, print_scores

if TYPE_CHECKING:
    from tensionlab.comparison.compare import Comparison, Row

COLUMNS: list[Column[Row]] = [
    ("error\nmean N", lambda row: output.short(row.residual_mean), False),
    ("error\nmax N", lambda row: output.short(row.residual_max), True),
    ("angle\nmean °", lambda row: output.short(row.angle_mean_deg), False),
    ("angle\nmax °", lambda row: output.short(row.angle_max_deg), True),
    ("mean t²\nN²", lambda row: output.short(row.tension_sq_mean), False),
    ("gap\nmax N", lambda row: output.short(row.gap_max), False),
    ("call\nmedian", lambda row: output.duration(row.call_median_s), True),
    ("call\np99", lambda row: output.duration(row.call_p99_s), False),
    ("batch\neach", lambda row: output.duration(row.batch_s), True),
]
"""Those after the statuses."""

LEGEND = """\
exact: limits kept, wrench rendered   near: proved out of reach, the policy's best substitute found
limit: neither proved   fail: the solver broke   error: desired minus rendered   angle: between the two forces
gap: largest difference of a tension to the exact optimum (newton's); without a policy, where reachable only
call: one force, measured and proved   batch: all forces in one call, time for each"""


def compare(
    rig: Annotated[Path, typer.Argument(help="Rig file (TOML).", show_default=False)],
    at: Annotated[
        str | None, typer.Option(metavar="X Y Z", help="Position in m; the rig's home if left out.")
    ] = None,
    magnitude: Annotated[float, typer.Option(help="Size of each force in N.")] = 1.5,
    directions: Annotated[
        str | None,
        typer.Option(
            metavar="SET",
            help="grid18, fibonacci:N, FILE.csv; planar: circle:N. Left out: grid18 or circle:72.",
        ),
    ] = None,
    solvers: Annotated[
        str | None, typer.Option(metavar="A,B,...", help="Solvers, such as newton,qp:daqp; all if left out.")
    ] = None,
    nearest: Annotated[
        str | None, typer.Option(help="Only this policy: force, tension or direction; all if left out.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(callback=output.picture_file, help="Draw to this file (png, pdf, svg).")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(callback=output.output_file(".parquet"), help="Write the rows to this Parquet file."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Compare every solver on one set of forces: what it renders, how far off it is, what it costs.

    The default is the published validation: 182 forces of 1.5 N (a grid of 18 degrees; the paper gives the
    count, the grid is inferred). Body frames stay at rest, at the origin of the world.
    """
    from tensionlab import records
    from tensionlab.comparison import compare as comparison
    from tensionlab.model import directions as direction_sets
    from tensionlab.model.files import load_rig

    loaded = load_rig(rig)
    names = None if solvers is None else [name.strip() for name in solvers.split(",") if name.strip()]
    output.check_solvers(loaded, names, nearest)
    with output.progress(f"Comparing on {loaded.name}") as progress:
        result = comparison.compare(
            loaded,
            position=None if at is None else output.numbers(at),
            directions=None if directions is None else direction_sets.parse(directions),
            magnitude=magnitude,
            solvers=names,
            nearest=nearest,  # type: ignore[arg-type]  # checked above
            progress=progress,
        )
    rows = [dataclasses.asdict(row) for row in result.rows]
    manifest = records.manifest(["tensionlab", *sys.argv[1:]])
    with output.Keeper(quiet=json) as keeper:
        if plot:
            keeper.write("plot", plot, lambda path: _draw(result, path))
        if out:
            keeper.write("rows", out, lambda path: records.write_parquet(path, rows, manifest))
        if json:
            output.print_json(
                {
                    "rig": loaded.name,
                    "position": result.position,
                    "vectors": len(result.wrenches),
                    "magnitude": magnitude,
                    "rows": rows,
                    "left_out": result.missing,
                    "manifest": manifest,
                }
            )
            return
        title = f"{loaded.name}, {loaded.m} modules: {len(result.wrenches)} forces of {magnitude:g} N"
        where = f"at {output.vector(result.position)} m"
        print_scores(f"{title} {where}", result.rows, COLUMNS, result.missing, LEGEND)


def _draw(result: Comparison, path: Path) -> None:
    from tensionlab.plots import plot_comparison

    plot_comparison(result, path)
