"""``tensionlab workspace``: where, and how well, rigs can pull."""

from __future__ import annotations

import json as json_text
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.options import BodyFrames, Box, Gravity, Required, Rotations, Scheduler, Step, Wrench
from tensionlab.cli.common.verbs import Json
from tensionlab.model.rig import Rig
from tensionlab.support.files.writing import unwritable
from tensionlab.support.formatting import format_number, format_share
from tensionlab.support.table import Column, Table
from tensionlab.workspace.metrics import metric
from tensionlab.workspace.poses import Grid, PoseList, describe_step, read_poses
from tensionlab.workspace.poses import box as box_of_poses
from tensionlab.workspace.sweep import sweep
from tensionlab.workspace.sweep.dataset import MEDIAN_SAMPLE, summary

if TYPE_CHECKING:
    import pandas

DEFAULT_METRICS = ["wrench-closure", "capacity-margin", "isotropic-force", "feasible-direction-fraction"]
DRAWN_METRIC = "capacity-margin"  # metric that is drawn if none is named
# What the characteristic length is, if the file of the rig has none.
ROOT_MEAN_SQUARE = "the root mean square distance of its attachments"
ORIENTATION_WORKSPACES = {"total": "in all orientations", "inclusive": "in one at least"}
# Message after Ctrl-C.
WITHOUT_STORE = "no values are kept; with --out DIR.zarr, the same command resumes the sweep"


class View(StrEnum):
    """What a picture shows."""

    slices = "slices"
    volume = "volume"
    shares = "shares"


def workspace(
    rigs: Annotated[list[str], options.rig_argument()],
    box: Box = None,
    step: Step = None,
    rotations: Rotations = None,
    poses: Annotated[Path | None, typer.Option(help="File of poses in place of a box (.csv, .parquet).")] = None,
    metrics: Annotated[
        list[str] | None,
        typer.Option(
            "--metric", metavar="A,B,...", help=f"Metrics, also repeated. Left out: {', '.join(DEFAULT_METRICS)}."
        ),
    ] = None,
    wrench: Wrench = None,
    gravity: Gravity = None,
    required: Required = None,
    frames: BodyFrames = None,
    out: Annotated[
        Path | None,
        options.writes_folder(
            "Write all values to this folder. The same command resumes an interrupted sweep.", ".zarr"
        ),
    ] = None,
    scheduler: Scheduler = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            callback=options.picture_file,
            help=f"Draw the first metric ({DRAWN_METRIC} if none is named) to this file (png, pdf, svg).",
        ),
    ] = None,
    view: Annotated[
        View,
        typer.Option(
            help="What to draw: slices of the box, its volume, or how large a share has at least a value."
        ),
    ] = View.slices,
    json: Json = False,
) -> None:
    """Evaluate where, and how well, rigs can pull.

    At every position of a box, or at the poses of a file. Platforms keep their home orientation in a box, unless
    there are rotations: then the table also says how much of the box is feasible in all of them, the total
    orientation workspace, which is drawn, and in one at least, the inclusive one.
    """
    loaded = [options.load(rig, frames, wrench, gravity, required) for rig in rigs]
    if poses is not None and (box or step or rotations):
        raise typer.BadParameter("--poses takes the place of --box, --step and --rotations; leave one out")
    if poses is not None and plot is not None:
        raise typer.BadParameter("--plot draws a box, not the poses of a file; leave one out")
    where: Grid | PoseList
    if poses is not None:
        where = read_poses(poses)
    else:
        ends, steps = options.parse_region(loaded, box, step)
        where = box_of_poses(*ends, step=steps, rotations=options.parse_orientations(loaded[0], rotations))
    names = options.parse_names(metrics)
    if names is None:
        names = [*["wrench-feasible"][: any(rig.required for rig in loaded)], *DEFAULT_METRICS]
    places = {name: place for rig in loaded for name, place in rig.at_rest.items()}
    resumed = WITHOUT_STORE if out is None else f"the same command resumes the sweep in {out}"
    with output.if_interrupted(resumed), output.ResultWriter(quiet=json) as writer:
        try:
            with output.progress("Poses") as progress:
                data = sweep(loaded, where, names, frames=places, out=out, scheduler=scheduler, progress=progress)
        except OSError as error:  # as Zarr has it, without the name of a file
            if out is None:
                raise
            raise unwritable(out, error) from None
        table, drawn_data = summary(data), data
        if rotations:
            axis = where.dims[-1]
            total, inclusive = data.min(axis, skipna=False, keep_attrs=True), data.max(axis, keep_attrs=True)
            table["total_above_zero"] = summary(total)["above_zero"]
            table["inclusive_above_zero"] = summary(inclusive)["above_zero"]
            drawn_data = total
        writer.draw(plot, view, drawn_data, metric=names[0] if metrics else DRAWN_METRIC)
        if json:
            output.print_json(
                poses=int(table["poses"].iloc[0]),
                out=out,
                rows=table.to_dict("records"),
                manifest=json_text.loads(data.manifest),
            )
        else:
            _print(table, where, out)
            _print_requirements(loaded)


def _print_requirements(rigs: list[Rig]) -> None:
    """Print what is required of each rig, and at which arm its torques count as forces."""
    for rig in rigs:
        if rig.required:
            output.print_line(f"required of {rig.name}: {rig.required.describe(rig)}", "dim")
        if rig.n > rig.dimension:
            text = f"torques of {rig.name} count as forces at {rig.characteristic_length:.3g} m in margins"
            own = rig.required.length is not None
            output.print_line(f"{text}, {'as required' if own else ROOT_MEAN_SQUARE}", "dim")


def _print(table: pandas.DataFrame, where: Grid | PoseList, out: Path | None) -> None:
    """Print a row for each rig and metric, then what the metrics mean."""
    metrics = {name: metric(name) for name in table["metric"].unique()}
    keys = {
        "rig": Column("rig"),
        "metric": Column("metric"),
        "unit": Column("unit"),
        **{name: Column(name, format=format_number) for name in ("min", "median", "max")},
        "above_zero": Column("above 0", format=format_share),
        "missing": Column("no value"),
        **{
            f"{name}_above_zero": Column(ORIENTATION_WORKSPACES[name], format=format_share)
            for name in ORIENTATION_WORKSPACES
        },
    }
    columns = {name: column for name, column in keys.items() if name in table}
    rows = []
    for row in table.to_dict("records"):
        if not metrics[row["metric"]].above_zero:
            row |= {name: None for name in row if name.endswith("above_zero")}
        row |= {"unit": row["unit"].removeprefix("1"), "missing": row["missing"] or None}
        rows.append([row[name] for name in columns])
    axes = {name: values for name, (_, values, _) in where.labels().items() if name in "xyz"}
    region = ", ".join(f"{name} {values.min():g} to {values.max():g} m" for name, values in axes.items())
    poses = int(table["poses"].iloc[0])
    places = int(np.prod(where.shape[: len(axes)])) if isinstance(where, Grid) else poses
    turns = f", {places:,} positions in {poses // places} orientations" if poses > places else ""
    step = describe_step(axes.values()) if isinstance(where, Grid) else ""
    title = f"{poses:,} poses{turns}{step and f', {step}'}: {region}"
    output.print_table(Table([*columns.values()], rows, title))
    output.print_line()
    for name, shown in metrics.items():
        meaning = f" Above 0: {shown.above_zero}." if shown.above_zero else ""
        output.print_prose(f"{name}: {shown.description}{meaning}", "dim")
    if step and any(shown.above_zero for shown in metrics.values()):
        output.print_prose(f"above 0: share of the volume, estimated from positions {step}", "dim")
    if table["missing"].any():
        output.print_prose("no value: a cable has no length there, or a force is infeasible", "dim")
    if poses > MEDIAN_SAMPLE:
        output.print_prose(f"median: of an even selection of {MEDIAN_SAMPLE:,} values at most", "dim")
    if out:
        output.print_line(f"values: {out}")
