"""``tensionlab certify``: prove where a rig renders what is required."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

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
from tensionlab.support.formatting import format_count
from tensionlab.workspace.certification.certify import SUFFIX
from tensionlab.workspace.certification.certify import certify as prove
from tensionlab.workspace.certification.problem import WRENCH_CLOSURE
from tensionlab.workspace.certification.result import Bounds, CertifiedWorkspace

VERDICTS = {1: "inside", -1: "outside", 0: "undecided"}
NOTHING_KEPT = "nothing is kept; with --out NAME.npz, the same command resumes the proof"  # message after Ctrl-C


def certify(
    rig: RigArgument,
    box: Box = None,
    step: Step = None,
    rotations: Rotations = None,
    wrench: Wrench = None,
    gravity: Gravity = None,
    required: Required = None,
    frames: BodyFrames = None,
    out: Annotated[
        Path | None,
        options.writes("Write the cells to this file. The same command resumes an interrupted proof.", SUFFIX),
    ] = None,
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
    resumed = NOTHING_KEPT if out is None else f"the same command resumes from {out}, if it is there"
    began = time.perf_counter()
    with output.if_interrupted(resumed), output.ResultWriter(quiet=json) as writer:
        with output.progress("Cells") as progress:
            proved = prove(
                loaded,
                region,
                loaded.required if loaded.required else WRENCH_CLOSURE,
                steps,
                rotations=options.parse_orientations(loaded, rotations),
                frames=loaded.at_rest,
                out=out,
                scheduler=scheduler,
                progress=progress,
            )
        duration_s = time.perf_counter() - began
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
            _print(proved, duration_s, out)


def _print(proved: CertifiedWorkspace, duration_s: float, out: Path | None) -> None:
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
    if out:
        output.print_line(f"cells: {out}")
