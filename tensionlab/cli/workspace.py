"""``tensionlab workspace``: where, and how well, rigs can pull."""

from __future__ import annotations

import dataclasses
import json as json_text
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from tensionlab.cli.common import output
from tensionlab.files.writing import unwritable

if TYPE_CHECKING:
    import xarray

    from tensionlab.model.rig import Rig
    from tensionlab.workspace.sweep.pose_sets import Grid, PoseList
    from tensionlab.workspace.sweep.summary import Summary

MEASURES = ["wrench-closure", "capacity-margin", "isotropic-force", "reachable-share"]
"""Asked for if nothing else is."""

DRAWN = "capacity-margin"
"""Drawn if no measure is named."""

STEPS = 40
"""Along the longest edge of the box, if no step is given."""


class View(StrEnum):
    """What a picture shows."""

    slices = "slices"
    volume = "volume"
    shares = "shares"


def workspace(
    rigs: Annotated[list[Path], typer.Argument(metavar="RIG...", help="Rig files (TOML).", show_default=False)],
    box: Annotated[
        str | None,
        typer.Option(
            metavar="X0 X1 Y0 Y1 Z0 Z1",
            help="Box of positions in m; Z0 = Z1 is a plane. Left out: the box of all anchors and homes.",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            metavar="STEP",
            help="Between positions, in m; one, or one for each axis. Left out: 40 in the longest edge.",
        ),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(help="File of poses in place of a box (.csv, .parquet, .npz).", show_default=False),
    ] = None,
    measures: Annotated[
        list[str] | None,
        typer.Option(
            "--measure", metavar="A,B,...", help=f"Measures, also repeated. Left out: {', '.join(MEASURES)}."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR.zarr",
            callback=output.output_folder(".zarr"),
            help="Write to this folder; a sweep that was killed goes on.",
            show_default=False,
        ),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Evaluate on a Dask cluster, tcp://HOST:PORT.", show_default=False)
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            callback=output.picture_file,
            help="Draw the first measure (capacity-margin if none is named) to this file (png, pdf, svg).",
        ),
    ] = None,
    view: Annotated[View, typer.Option(help="What to draw.")] = View.slices,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Measure where, and how well, rigs can pull: at every position of a box, or at the poses of a file.

    Platforms keep their home orientation in a box. Body frames stay at rest, at the origin of the world.
    """
    from tensionlab.model.files import load_rig
    from tensionlab.workspace.paths import read_poses
    from tensionlab.workspace.sweep import sweep
    from tensionlab.workspace.sweep.summary import summarise

    loaded = [load_rig(path) for path in rigs]
    if poses is not None and (box is not None or step is not None):
        raise typer.BadParameter("--poses takes the place of --box and --step; leave one out")
    if poses is not None and plot is not None:
        raise typer.BadParameter("--plot draws a box, not the poses of a file; leave one out")
    where = _box(loaded, box, step) if poses is None else read_poses(poses)
    frames = {name: place for rig in loaded for name, place in rig.at_rest.items()}
    asked = output.words(measures)
    asked = MEASURES if asked is None else asked
    try:
        data = sweep(loaded, where, asked, frames=frames, out=out, scheduler=scheduler)
    except OSError as error:  # as Zarr has it, without the name of a file
        if out is None:
            raise
        raise unwritable(out, error) from None
    found = [(rig.name, name, summarise(data[name].sel(rig=rig.name))) for rig in loaded for name in asked]
    with output.Keeper(quiet=json) as keeper:
        if plot is not None:
            keeper.write("plot", plot, lambda path: _draw(data, path, view, asked[0] if measures else DRAWN))
        if json:
            output.print_json(
                {
                    "poses": found[0][2].poses,
                    "out": None if out is None else str(out),
                    "rows": [
                        {"rig": rig, "measure": name, "unit": data[name].units, **dataclasses.asdict(summary)}
                        for rig, name, summary in found
                    ],
                    "manifest": json_text.loads(data.manifest),
                }
            )
        else:
            _print(found, where, out)


def _draw(data: xarray.Dataset, path: Path, view: View, measure: str) -> None:
    from tensionlab import plots

    if view is View.volume:
        plots.plot_volume(data, path, measure=measure)
    else:
        draw = plots.plot_slices if view is View.slices else plots.plot_shares
        draw(data, path, measure)


def _box(rigs: list[Rig], box: str | None, step: str | None) -> Grid:
    """The positions to ask at."""
    from tensionlab.workspace import paths

    dimension = rigs[0].dimension
    if box is None:
        points = np.concatenate([[rig.home, *rig.anchors] for rig in rigs if rig.dimension == dimension])
        ends = np.stack([points.min(axis=0), points.max(axis=0)], axis=-1)
    else:
        numbers = output.numbers(box)
        if len(numbers) != 2 * dimension:
            names = " ".join(f"{axis}0 {axis}1" for axis in "xyz"[:dimension])
            raise typer.BadParameter(
                f"--box has {len(numbers)} numbers; {rigs[0].name} needs {2 * dimension}: {names}"
            )
        ends = np.array(numbers).reshape(dimension, 2)
    steps = [float(np.ptp(ends, axis=1).max()) / STEPS or 1.0] if step is None else output.numbers(step)
    return paths.box(*ends, step=steps if len(steps) > 1 else steps[0])


def _print(found: list[tuple[str, str, Summary]], where: Grid | PoseList, out: Path | None) -> None:
    """One row for each rig and measure, then what the measures mean."""
    from tensionlab.workspace import registry as catalogue
    from tensionlab.workspace.sweep.summary import SAMPLE

    console = output.console()
    grid = output.table(f"{found[0][2].poses:,} poses: {_where(where)}")
    for heading in ("rig", "measure", "unit", "least", "median", "largest", "above 0", "no value"):
        grid.add_column(
            heading, justify="left" if heading in ("rig", "measure", "unit") else "right", no_wrap=True
        )
    last = ""
    asked = dict.fromkeys(name for _, name, _ in found)
    for rig, name, summary in found:
        measure = catalogue.make(name)
        grid.add_row(
            "" if rig == last else rig,
            name,
            "" if measure.unit == "1" else measure.unit,
            output.short(summary.least),
            output.short(summary.median),
            output.short(summary.largest),
            f"{100 * summary.above_zero:.1f} %" if measure.above_zero else "",
            f"{summary.missing:,}" if summary.missing else "",
        )
        last = rig
    console.print(grid)
    console.print()
    for name in asked:
        measure = catalogue.make(name)
        meaning = f" Above 0: {measure.above_zero}." if measure.above_zero else ""
        console.print(f"{name}: {catalogue.question(measure)}{meaning}", style="dim")
    if any(summary.missing for *_, summary in found):
        console.print(
            "no value: a cable has no length there, or a force whose effort is asked for is out of reach",
            style="dim",
        )
    if found[0][2].poses > SAMPLE:
        console.print(f"median: of an even selection of {SAMPLE:,} values at most", style="dim")
    if out:
        console.print(f"values: {out}", soft_wrap=True)


def _where(poses: Grid | PoseList) -> str:
    """The region that poses cover."""
    position = [coordinate for coordinate in poses.coordinates() if coordinate.name in "xyz"]
    return ", ".join(f"{each.name} {each.values.min():g} to {each.values.max():g} m" for each in position)
