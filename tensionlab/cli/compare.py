"""``tensionlab compare``: all solvers on the same forces."""

from __future__ import annotations

import dataclasses
from typing import Annotated

from tensionlab.benchmark import comparison
from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, option
from tensionlab.support import provenance


def compare(
    rig: options.RigArgument,
    at: options.At = None,
    magnitude: Annotated[
        float | None,
        option("NEWTON", "Size of each force. Left out: a required ball's radius, the weight, or 1.5 N."),
    ] = None,
    directions: Annotated[
        str | None,
        option(
            "SET", "Directions: grid18, fibonacci:N or FILE.csv (x, y, z); in a plane, circle:N, 72 if left out."
        ),
    ] = None,
    solvers: options.Solvers = None,
    policy: Annotated[
        str | None, option("POLICY", "Only this policy for infeasible wrenches: force, tension, direction.")
    ] = None,
    wrench: options.Wrench = None,
    gravity: options.Gravity = None,
    required: options.Required = None,
    frames: options.BodyFrames = None,
    plot: options.Plot = None,
    out: options.Rows = None,
    json: Json = False,
) -> None:
    """Compare solvers on one set of forces.

    Shows what each renders, how far off it is, and how long it takes.

    The default is the published validation: 182 forces (a grid of 18 degrees; the paper gives the count, the
    grid is inferred) of 1.5 N, or of the platform's weight if the rig's file has it. They are added to what is
    required: a wrench, the weight; the wrenches of a required list or the corners of a box are compared in their
    place, unless directions are given.
    """
    loaded = options.load(rig, frames, wrench, gravity, required)
    names = options.parse_names(solvers)
    options.check_solvers(loaded, names, policy)
    with output.progress(f"Comparing on {loaded.name}") as progress:
        result = comparison.compare(
            loaded,
            position=options.parse_position(at, loaded),
            directions=directions,
            magnitude=magnitude,
            solvers=names,
            policy=policy,  # type: ignore[arg-type]  # checked above
            progress=progress,
        )
    manifest = output.manifest()
    with output.ResultWriter(quiet=json) as writer:
        writer.draw(plot, "comparison", result)
        if out:
            rows = [dataclasses.asdict(row) for row in result.rows]
            writer.write("rows", out, lambda path: provenance.write_table(path, rows, manifest))
        if json:
            output.print_json(
                rig=loaded.name,
                position=result.position,
                vectors=len(result.wrenches),
                magnitude=result.magnitude,
                rows=result.rows,
                left_out=result.missing,
                failures=result.failures,
                manifest=manifest,
            )
        else:
            output.print_table(result.table())
