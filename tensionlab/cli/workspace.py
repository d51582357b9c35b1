"""``tensionlab workspace`` and ``certify``: where rigs can pull and how well, sampled or proved."""

from __future__ import annotations

import json as json_text
import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, option
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing
from tensionlab.support.formatting import format_count, format_number, format_share
from tensionlab.support.table import Column, Table
from tensionlab.workspace.certification import WRENCH_CLOSURE
from tensionlab.workspace.certification import certify as prove
from tensionlab.workspace.certified import Bounds, CertifiedWorkspace
from tensionlab.workspace.metrics import metric
from tensionlab.workspace.poses import Grid, PoseList, read_poses
from tensionlab.workspace.poses import box as box_of_poses
from tensionlab.workspace.shares import describe_step
from tensionlab.workspace.sweep import sweep
from tensionlab.workspace.sweep.dataset import MEDIAN_SAMPLE, summary

if TYPE_CHECKING:
    import pandas

DEFAULT_METRICS = ["wrench-closure", "capacity-margin", "isotropic-force", "feasible-direction-fraction"]
DRAWN_METRIC = "capacity-margin"  # metric that is drawn if none is named
VERDICTS = {1: "inside", -1: "outside", 0: "undecided"}
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
    poses: Annotated[
        Path | None,
        option(
            "FILE",
            "File of poses in place of a box (.csv, .parquet): x, y, z in m; optional rx, ry, rz in rad, and a "
            "wrench that is also required there: Fx, Fy, Fz in N, Mx, My, Mz in N·m.",
        ),
    ] = None,
    metrics: Annotated[
        list[str] | None,
        option("A,B,...", f"Metrics; may be repeated. Left out: {', '.join(DEFAULT_METRICS)}.", "--metric"),
    ] = None,
    wrench: options.Wrench = None,
    gravity: options.Gravity = None,
    acceleration: options.Acceleration = None,
    required: options.Required = None,
    frames: options.BodyFrames = None,
    out: Annotated[
        str | None,
        options.writes_folder("Write all values to this folder, or URL (s3://...); it resumes a sweep.", ".zarr"),
    ] = None,
    scheduler: options.Scheduler = None,
    plot: options.Plot = None,
    view: Annotated[View, typer.Option(help="What to draw of the first metric.")] = View.slices,
    json: Json = False,
) -> None:
    """Evaluate where, and how well, rigs can pull.

    At every position of a box, or at the poses of a file. Platforms keep their home orientation in a box, unless
    there are rotations: then the table also says how much of the box is feasible in all of them, the total
    orientation workspace, which is drawn, and in one at least, the inclusive one.
    """
    loaded = [options.load(rig, frames, wrench, gravity, required, acceleration) for rig in rigs]
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
        loads = isinstance(where, PoseList) and where.wrench is not None
        names = [*["wrench-feasible"][: loads or any(rig.required for rig in loaded)], *DEFAULT_METRICS]
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
            raise writing.unwritable(out, error) from None
        statistics, drawn = summary(data), data
        if rotations:
            axis = where.dims[-1]
            drawn = data.min(axis, skipna=False, keep_attrs=True)
            statistics["total_above_zero"] = summary(drawn)["above_zero"]
            statistics["inclusive_above_zero"] = summary(data.max(axis, keep_attrs=True))["above_zero"]
        writer.draw(plot, view, drawn, metric=names[0] if metrics else DRAWN_METRIC)
        if json:
            rows, manifest = statistics.to_dict("records"), json_text.loads(data.manifest)
            output.print_json(poses=int(statistics["poses"].iloc[0]), out=out, rows=rows, manifest=manifest)
        else:
            output.print_table(_metrics_table(statistics, where, loaded))
            if out:
                output.print_line(f"values: {out}")


def _metrics_table(found: pandas.DataFrame, where: Grid | PoseList, rigs: list[Rig]) -> Table:
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
        row |= {"unit": _unit(row, rigs), "missing": row["missing"] or None}
        rows.append([row[name] for name in columns])
    axes = {name: values for name, (_, values, _) in where.labels().items() if name in "xyz"}
    region = ", ".join(f"{name} {values.min():g} to {values.max():g} m" for name, values in axes.items())
    poses = int(found["poses"].iloc[0])
    title, step = f"{poses:,} poses", describe_step(axes.values()) if isinstance(where, Grid) else ""
    if isinstance(where, Grid):
        places = int(np.prod(where.shape[: len(axes)]))
        title += f", {places:,} positions in {poses // places} orientations" * (poses > places)
    title += f", {step}" * bool(step)
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
    if isinstance(where, PoseList) and where.wrench is not None:
        notes.append("required in addition: the wrench of each pose")
    for rig in rigs:
        if rig.required:
            notes.append(f"required of {rig.name}: {rig.required.describe(rig)}")
        if rig.n > rig.dimension:
            own = (
                "as required"
                if rig.required.length is not None
                else "the root mean square distance of its attachments"
            )
            arm = f"{rig.characteristic_length:.3g} m in margins, {own}"
            notes.append(f"torques of {rig.name} count as forces at {arm}")
    return Table([*columns.values()], rows, f"{title}: {region}", notes)


def _unit(row: dict[str, Any], rigs: list[Rig]) -> str:
    """Return the unit of a row: of a spherical rig, forces and margins are torques."""
    torque = any(rig.name == row["rig"] and not rig.has_position for rig in rigs)
    return "N·m" if torque and row["unit"] == "N" else str(row["unit"]).removeprefix("1")


@output.if_interrupted(output.NOTHING_KEPT)
def certify(
    rig: options.RigArgument,
    box: options.Box = None,
    step: options.Step = None,
    rotations: options.Rotations = None,
    wrench: options.Wrench = None,
    gravity: options.Gravity = None,
    acceleration: options.Acceleration = None,
    required: options.Required = None,
    frames: options.BodyFrames = None,
    loss: Annotated[int, option("0|1", "1: prove what survives the loss of any one cable.", min=0, max=1)] = 0,
    gap: Annotated[float, option("SHARE", "Stop when at most this share is undecided.", min=0.0, max=0.99)] = 0.0,
    out: Annotated[Path | None, options.writes("Write the cells to this file.", ".npz")] = None,
    scheduler: options.Scheduler = None,
    plot: options.Plot = None,
    json: Json = False,
) -> None:
    """Prove where a rig renders what is required.

    The box is divided into cells, each of which is proved inside, in all orientations, proved outside, or left
    undecided. If nothing is required, wrench closure is proved.
    """
    loaded = options.load(rig, frames, wrench, gravity, required, acceleration)
    region, steps = options.parse_region([loaded], box, step)
    turned = options.parse_orientations(loaded, rotations)
    required_wrenches = loaded.required if loaded.required else WRENCH_CLOSURE
    began = time.perf_counter()
    with output.ResultWriter(quiet=json) as writer:
        with output.progress("Cells") as bar:

            def report(done: float, volume: Bounds) -> None:
                bar(done, f"{volume.describe()} inside")

            proved = prove(loaded, region, required_wrenches, steps, rotations=turned, losses=loss, gap=gap,
                           frames=loaded.at_rest, scheduler=scheduler, progress=report)  # fmt: skip
        duration_s = time.perf_counter() - began
        if out is not None:
            writer.write("cells", out, lambda path: _write_cells(path, proved))
        writer.draw(plot, "certified", proved)
        if json:
            output.print_json(
                rig=loaded.name,
                **output.fields(proved, "required", "unit", "region_volume", "volume", "share", "evaluations"),
                cells={VERDICTS[verdict]: cells for verdict, (cells, _) in proved.tally().items()},
                losses={name: output.fields(proof, "volume", "share") for name, proof in proved.losses.items()},
                duration_s=duration_s,
                out=out,
                manifest=output.manifest(),
            )
        else:
            output.print_table(_proof_table(proved, duration_s))
            if proved.losses:
                output.print_line()
                output.print_table(proved.losses_table())


def _write_cells(path: Path, proved: CertifiedWorkspace) -> None:
    with writing.replacing(path) as file:
        np.savez_compressed(
            file, centre=proved.centres, edge=proved.edges, verdict=proved.verdict, share=proved.shares
        )


def _proof_table(proved: CertifiedWorkspace, duration_s: float) -> Table:
    cells, table = proved.subdivision, proved.table()
    axes = zip("xyz", cells.low, cells.low + cells.extent, strict=False)
    region = ", ".join(f"{axis} {low:g} to {high:g} m" for axis, low, high in axes)
    shares = Bounds(*(100 * share for share in proved.share)).describe()
    finest = f"{format_count(proved.evaluations, 'cell')} down to {cells.edges(cells.levels).max():.3g} m"
    table.title = f"{proved.rig.name}, {proved.required}: {region}"
    table.notes = [f"workspace: {proved.volume.describe()} {proved.unit}, {shares} % of the box",
                   f"evaluated: {finest}, in {duration_s:.1f} s"]  # fmt: skip
    return table
