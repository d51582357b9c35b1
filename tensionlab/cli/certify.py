"""``tensionlab certify``: prove where a rig renders what is required."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import numpy as np

from tensionlab.cli.common import options, output
from tensionlab.cli.common.options import (
    BodyFrames,
    Box,
    Gravity,
    Plot,
    Required,
    RigArgument,
    Rotations,
    Scheduler,
    Step,
    Wrench,
)
from tensionlab.cli.common.verbs import Json
from tensionlab.support.files import writing
from tensionlab.support.formatting import format_count
from tensionlab.workspace.certification import WRENCH_CLOSURE
from tensionlab.workspace.certification import certify as prove
from tensionlab.workspace.certified import Bounds, CertifiedWorkspace

VERDICTS = {1: "inside", -1: "outside", 0: "undecided"}


def certify(
    rig: RigArgument,
    box: Box = None,
    step: Step = None,
    rotations: Rotations = None,
    wrench: Wrench = None,
    gravity: Gravity = None,
    required: Required = None,
    frames: BodyFrames = None,
    out: Annotated[Path | None, options.writes("Write the cells to this file.", ".npz")] = None,
    scheduler: Scheduler = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Prove where a rig renders what is required.

    The box is divided into cells, each of which is proved inside, in all orientations, proved outside, or left
    undecided. If nothing is required, wrench closure is proved.
    """
    loaded = options.load(rig, frames, wrench, gravity, required)
    region, steps = options.parse_region([loaded], box, step)
    began = time.perf_counter()
    with output.if_interrupted(output.NOTHING_KEPT), output.ResultWriter(quiet=json) as writer:
        with output.progress("Cells") as progress:
            proved = prove(
                loaded,
                region,
                loaded.required if loaded.required else WRENCH_CLOSURE,
                steps,
                rotations=options.parse_orientations(loaded, rotations),
                frames=loaded.at_rest,
                scheduler=scheduler,
                progress=progress,
            )
        duration_s = time.perf_counter() - began
        if out is not None:
            writer.write("cells", out, lambda path: _write_cells(path, proved))
        writer.draw(plot, "certified", proved)
        if json:
            output.print_json(
                rig=loaded.name,
                required=proved.required,
                unit=proved.unit,
                region_volume=proved.region_volume,
                volume=proved.volume,
                share=proved.share,
                cells={VERDICTS[verdict]: cells for verdict, (cells, _) in proved.tally().items()},
                evaluations=proved.evaluations,
                duration_s=duration_s,
                out=out,
                manifest=output.manifest(),
            )
        else:
            _print(proved, duration_s)


def _write_cells(path: Path, proved: CertifiedWorkspace) -> None:
    """Write of each cell its centre, edges, verdict, and the shares proved inside and outside."""
    with writing.replacing(path) as file:
        np.savez_compressed(
            file, centre=proved.centres, edge=proved.edges, verdict=proved.verdict, share=proved.shares
        )


def _print(proved: CertifiedWorkspace, duration_s: float) -> None:
    """Print how many cells are proved, and the bounds of the workspace's volume."""
    cells = proved.subdivision
    axes = zip("xyz", cells.low, cells.low + cells.extent, strict=False)
    table = proved.table()
    table.title = f"{proved.rig.name}, {proved.required}: " + ", ".join(
        f"{axis} {low:g} to {high:g} m" for axis, low, high in axes
    )
    table.notes = []
    output.print_table(table)
    output.print_line()
    shares = Bounds(*(100 * each for each in proved.share)).describe()
    output.print_line(f"workspace: {proved.volume.describe()} {proved.unit}, {shares} % of the box")
    finest = f"{format_count(proved.evaluations, 'cell')} down to {cells.edges(cells.levels).max():.3g} m"
    output.print_line(f"looked at: {finest}, in {duration_s:.1f} s", "dim")
