"""``tensionlab certify``: prove where a rig renders what is required."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import numpy as np

from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json
from tensionlab.support.files import writing
from tensionlab.support.formatting import format_count
from tensionlab.support.table import Table
from tensionlab.workspace.certification import WRENCH_CLOSURE
from tensionlab.workspace.certification import certify as prove
from tensionlab.workspace.certified import Bounds, CertifiedWorkspace

VERDICTS = {1: "inside", -1: "outside", 0: "undecided"}


@output.if_interrupted(output.NOTHING_KEPT)
def certify(
    rig: options.RigArgument,
    box: options.Box = None,
    step: options.Step = None,
    rotations: options.Rotations = None,
    wrench: options.Wrench = None,
    gravity: options.Gravity = None,
    required: options.Required = None,
    frames: options.BodyFrames = None,
    out: Annotated[Path | None, options.writes("Write the cells to this file.", ".npz")] = None,
    scheduler: options.Scheduler = None,
    plot: options.Plot = None,
    json: Json = False,
) -> None:
    """Prove where a rig renders what is required.

    The box is divided into cells, each of which is proved inside, in all orientations, proved outside, or left
    undecided. If nothing is required, wrench closure is proved.
    """
    loaded = options.load(rig, frames, wrench, gravity, required)
    region, steps = options.parse_region([loaded], box, step)
    turned = options.parse_orientations(loaded, rotations)
    required_wrenches = loaded.required if loaded.required else WRENCH_CLOSURE
    began = time.perf_counter()
    with output.ResultWriter(quiet=json) as writer:
        with output.progress("Cells") as progress:
            proved = prove(loaded, region, required_wrenches, steps, rotations=turned, frames=loaded.at_rest,
                           scheduler=scheduler, progress=progress)  # fmt: skip
        duration_s = time.perf_counter() - began
        if out is not None:
            writer.write("cells", out, lambda path: _write_cells(path, proved))
        writer.draw(plot, "certified", proved)
        if json:
            output.print_json(
                rig=loaded.name,
                **output.fields(proved, "required", "unit", "region_volume", "volume", "share", "evaluations"),
                cells={VERDICTS[verdict]: cells for verdict, (cells, _) in proved.tally().items()},
                duration_s=duration_s,
                out=out,
                manifest=output.manifest(),
            )
        else:
            output.print_table(_table(proved, duration_s))


def _write_cells(path: Path, proved: CertifiedWorkspace) -> None:
    """Write of each cell its centre, edges, verdict, and the shares proved inside and outside."""
    with writing.replacing(path) as file:
        np.savez_compressed(
            file, centre=proved.centres, edge=proved.edges, verdict=proved.verdict, share=proved.shares
        )


def _table(proved: CertifiedWorkspace, duration_s: float) -> Table:
    """Return how many cells are proved, with the bounds of the workspace's volume."""
    cells, table = proved.subdivision, proved.table()
    axes = zip("xyz", cells.low, cells.low + cells.extent, strict=False)
    region = ", ".join(f"{axis} {low:g} to {high:g} m" for axis, low, high in axes)
    shares = Bounds(*(100 * each for each in proved.share)).describe()
    finest = f"{format_count(proved.evaluations, 'cell')} down to {cells.edges(cells.levels).max():.3g} m"
    table.title = f"{proved.rig.name}, {proved.required}: {region}"
    table.notes = [f"workspace: {proved.volume.describe()} {proved.unit}, {shares} % of the box",
                   f"evaluated: {finest}, in {duration_s:.1f} s"]  # fmt: skip
    return table
