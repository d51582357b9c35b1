"""``tensionlab certify``: prove where a rig renders what is required."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from tensionlab.cli.common import options, output
from tensionlab.cli.common.options import BodyFrames, Plot
from tensionlab.cli.common.region import Box, Rotations, Scheduler, Step, parse_orientations, parse_region
from tensionlab.cli.common.required import Gravity, Required, Wrench, with_requirement
from tensionlab.cli.common.verbs import Json
from tensionlab.model.files import load_rig
from tensionlab.support.formatting import format_count
from tensionlab.workspace.certification.certify import SUFFIX
from tensionlab.workspace.certification.certify import certify as prove
from tensionlab.workspace.certification.problem import WRENCH_CLOSURE
from tensionlab.workspace.certification.result import Bounds, CertifiedWorkspace

VERDICTS = {1: "inside", -1: "outside", 0: "undecided"}
NOTHING_KEPT = "nothing is kept; with --out NAME.npz, the same command resumes the proof"  # message after Ctrl-C


def certify(
    rig: options.RigArgument,
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
    loaded = with_requirement(options.with_frames(load_rig(rig), frames), wrench, gravity, required)
    region, steps = parse_region([loaded], box, step)
    resumed = NOTHING_KEPT if out is None else f"the same command resumes from {out}, if it is there"
    began = time.perf_counter()
    with output.if_interrupted(resumed), output.ResultWriter(quiet=json) as writer:
        with output.progress("Cells") as progress:
            proved = prove(
                loaded,
                region,
                loaded.required if loaded.required else WRENCH_CLOSURE,
                steps,
                rotations=parse_orientations(loaded, rotations),
                frames=loaded.at_rest,
                out=out,
                scheduler=scheduler,
                progress=progress,
            )
        duration_s = time.perf_counter() - began
        if plot is not None:
            from tensionlab.plots import plot_certified, save_figure

            writer.write("plot", plot, lambda path: save_figure(plot_certified(proved), path))
        if json:
            _print_json(proved, duration_s, out)
        else:
            _print(proved, duration_s, out)


def _print_json(proved: CertifiedWorkspace, duration_s: float, out: Path | None) -> None:
    output.print_json(
        rig=proved.rig.name,
        required=proved.required,
        unit=proved.unit,
        region_volume=proved.region_volume,
        volume=proved.volume._asdict(),
        share=proved.share._asdict(),
        cells={VERDICTS[verdict]: cells for verdict, (cells, _) in proved.tally().items()},
        evaluations=proved.evaluations,
        duration_s=duration_s,
        out=None if out is None else str(out),
        manifest=output.manifest(),
    )


def _print(proved: CertifiedWorkspace, duration_s: float, out: Path | None) -> None:
    """Print how many cells are proved, and between which bounds the workspace lies."""
    cells = proved.subdivision
    axes = zip("xyz", cells.low, cells.low + cells.extent, strict=False)
    title = ", ".join(f"{axis} {low:g} to {high:g} m" for axis, low, high in axes)
    table = proved.table()
    table.title, table.notes = f"{proved.rig.name}, {proved.required}: {title}", []
    output.print_table(table)
    console = output.console()
    console.print()
    shares = Bounds(*(100 * each for each in proved.share)).describe()
    console.print(f"workspace: {proved.volume.describe()} {proved.unit}, {shares} % of the box", soft_wrap=True)
    finest = f"{format_count(proved.evaluations, 'cell')} down to {cells.edges(cells.levels).max():.3g} m"
    console.print(f"looked at: {finest}, in {duration_s:.1f} s", style="dim", soft_wrap=True)
    if out:
        console.print(f"cells: {out}", soft_wrap=True)
