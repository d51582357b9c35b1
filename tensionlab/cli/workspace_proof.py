"""``tensionlab workspace --certify``: where a rig renders what is required for sure."""

from __future__ import annotations

import time
from pathlib import Path

from tensionlab.cli.common import output
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_count, format_share
from tensionlab.workspace.certification.certify import certify
from tensionlab.workspace.certification.problem import WRENCH_CLOSURE
from tensionlab.workspace.certification.result import Bounds, CertifiedWorkspace

HEADINGS = ("<proved", "cells", "volume", "share of\nthe box")
VERDICTS = {1: "inside", -1: "outside", 0: "undecided"}
NOTHING_KEPT = "nothing is kept; with --out NAME.npz, the same command goes on where it was"
"""What Ctrl-C leaves to say."""


def prove(
    rig: Rig,
    region: Floats,
    steps: list[float],
    rotations: Floats | None,
    *,
    out: Path | None,
    scheduler: str | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Prove where in a region (d, 2) a rig renders what is required, or has wrench closure; print and draw it."""
    go_on = NOTHING_KEPT if out is None else f"the same command goes on with what {out} holds, if it is there"
    began = time.perf_counter()
    with output.if_interrupted(go_on), output.ResultWriter(quiet=json) as writer:
        with output.progress("Cells") as progress:
            proved = certify(
                rig,
                region,
                rig.required if rig.required else WRENCH_CLOSURE,
                steps if len(steps) > 1 else steps[0],
                rotations=rotations,
                frames=rig.at_rest,
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
    cells, region = proved.subdivision, proved.region_volume
    axes = zip("xyz", cells.low, cells.low + cells.extent, strict=False)
    title = ", ".join(f"{axis} {low:g} to {high:g} m" for axis, low, high in axes)
    rows = [
        (VERDICTS[verdict], f"{cells_of:,}", f"{volume:.4g} {proved.unit}", format_share(volume / region))
        for verdict, (cells_of, volume) in proved.tally().items()
    ]
    output.print_table(f"{proved.rig.name}, {proved.required}: {title}", HEADINGS, rows)
    console = output.console()
    console.print()
    shares = Bounds(*(100 * each for each in proved.share)).describe()
    console.print(f"workspace: {proved.volume.describe()} {proved.unit}, {shares} % of the box", soft_wrap=True)
    finest = f"{format_count(proved.evaluations, 'cell')} down to {cells.edges(cells.levels).max():.3g} m"
    console.print(f"looked at: {finest}, in {duration_s:.1f} s", style="dim", soft_wrap=True)
    if out:
        console.print(f"cells: {out}", soft_wrap=True)
