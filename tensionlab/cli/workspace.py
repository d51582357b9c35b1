"""``tensionlab workspace``: where, and how well, rigs can pull."""

from __future__ import annotations

import json as json_text
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, option
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
ORIENTATION_WORKSPACES = {"total": "in all orientations", "inclusive": "in one at least"}


class View(StrEnum):
    """What a picture shows."""

    slices = "slices"
    volume = "volume"
    shares = "shares"


def workspace(
    rigs: Annotated[list[str], options.rig_argument()],
    box: options.Box = None,
    step: options.Step = None,
    rotations: options.Rotations = None,
    poses: Annotated[Path | None, option("FILE", "File of poses in place of a box (.csv, .parquet).")] = None,
    metrics: Annotated[
        list[str] | None,
        option("A,B,...", f"Metrics; may be repeated. Left out: {', '.join(DEFAULT_METRICS)}.", "--metric"),
    ] = None,
    wrench: options.Wrench = None,
    gravity: options.Gravity = None,
    required: options.Required = None,
    frames: options.BodyFrames = None,
    out: Annotated[
        Path | None,
        options.writes_folder(
            "Write all values to this folder. The same command resumes an interrupted sweep.", ".zarr"
        ),
    ] = None,
    scheduler: options.Scheduler = None,
    plot: options.Plot = None,
    view: Annotated[
        View, typer.Option(help="What to draw of the first metric, or of the capacity margin.")
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
    kept = f"the same command resumes the sweep in {out}"
    if out is None:
        kept = "no values are kept; with --out DIR.zarr, the same command resumes the sweep"
    with output.if_interrupted(kept), output.ResultWriter(quiet=json) as writer:
        try:
            with output.progress("Poses") as progress:
                data = sweep(loaded, where, names, frames=places, out=out, scheduler=scheduler, progress=progress)
        except OSError as error:  # as Zarr has it, without the name of a file
            if out is None:
                raise
            raise unwritable(out, error) from None
        found, drawn = summary(data), data
        if rotations:
            axis = where.dims[-1]
            drawn = data.min(axis, skipna=False, keep_attrs=True)
            found["total_above_zero"] = summary(drawn)["above_zero"]
            found["inclusive_above_zero"] = summary(data.max(axis, keep_attrs=True))["above_zero"]
        writer.draw(plot, view, drawn, metric=names[0] if metrics else DRAWN_METRIC)
        if json:
            rows, manifest = found.to_dict("records"), json_text.loads(data.manifest)
            output.print_json(poses=int(found["poses"].iloc[0]), out=out, rows=rows, manifest=manifest)
        else:
            output.print_table(_table(found, where, loaded))
            if out:
                output.print_line(f"values: {out}")


def _table(found: pandas.DataFrame, where: Grid | PoseList, rigs: list[Rig]) -> Table:
    """Return a row for each rig and metric; notes say what the metrics and requirements mean."""
    metrics = {name: metric(name) for name in found["metric"].unique()}
    columns = {
        **{name: Column(name) for name in ("rig", "metric", "unit")},
        **{name: Column(name, format=format_number) for name in ("min", "median", "max")},
        "above_zero": Column("above 0", format=format_share),
        "missing": Column("no value"),
        **{
            f"{name}_above_zero": Column(title, format=format_share)
            for name, title in ORIENTATION_WORKSPACES.items()
        },
    }
    columns = {name: column for name, column in columns.items() if name in found}
    rows = []
    for row in found.to_dict("records"):
        if not metrics[row["metric"]].above_zero:
            row |= {name: None for name in row if name.endswith("above_zero")}
        row |= {"unit": row["unit"].removeprefix("1"), "missing": row["missing"] or None}
        rows.append([row[name] for name in columns])
    axes = {name: values for name, (_, values, _) in where.labels().items() if name in "xyz"}
    region = ", ".join(f"{name} {values.min():g} to {values.max():g} m" for name, values in axes.items())
    poses = int(found["poses"].iloc[0])
    title, step = f"{poses:,} poses", ""
    if isinstance(where, Grid):
        places, step = int(np.prod(where.shape[: len(axes)])), describe_step(axes.values())
        title += f", {places:,} positions in {poses // places} orientations" * (poses > places) + f", {step}"
    notes = [
        f"{name}: {shown.description}" + (f" Above 0: {shown.above_zero}." if shown.above_zero else "")
        for name, shown in metrics.items()
    ]
    if step and any(shown.above_zero for shown in metrics.values()):
        notes.append(f"above 0: share of the volume, estimated from positions {step}")
    if found["missing"].any():
        notes.append("no value: a cable has no length there, or a force is infeasible")
    if poses > MEDIAN_SAMPLE:
        notes.append(f"median: of an even selection of {MEDIAN_SAMPLE:,} values at most")
    for rig in rigs:
        if rig.required:
            notes.append(f"required of {rig.name}: {rig.required.describe(rig)}")
        if rig.n > rig.dimension:
            own = (
                "as required"
                if rig.required.length is not None
                else "the root mean square distance of its attachments"
            )
            notes.append(
                f"torques of {rig.name} count as forces at {rig.characteristic_length:.3g} m in margins, {own}"
            )
    return Table([*columns.values()], rows, f"{title}: {region}", notes)
