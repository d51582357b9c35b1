"""``tensionlab workspace``: where, and how well, rigs can pull."""

from __future__ import annotations

import dataclasses
import json as json_text
import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from tensionlab.cli import workspace_proof
from tensionlab.cli.common import options, output
from tensionlab.cli.common.options import BodyFrames
from tensionlab.cli.common.required import Gravity, Required, Wrench, with_requirement
from tensionlab.cli.common.verbs import Json
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files.writing import unwritable
from tensionlab.support.formatting import format_count
from tensionlab.workspace.certification.certify import SUFFIX as PROOF_SUFFIX
from tensionlab.workspace.metrics import description, make
from tensionlab.workspace.orientations import over_orientations, parse_rotations
from tensionlab.workspace.poses import Grid, PoseList, read_poses
from tensionlab.workspace.poses import box as box_of_poses
from tensionlab.workspace.sweep import sweep
from tensionlab.workspace.sweep.dataset import MEDIAN_SAMPLE, SUMMARY_HEADINGS, Summary, SweepSummary, summary

DEFAULT_METRICS = ["wrench-closure", "capacity-margin", "isotropic-force", "reachable-share"]
DRAWN_METRIC = "capacity-margin"
"""If none is named."""
ROOT_MEAN_SQUARE = "the root mean square distance of its attachments"
"""What the characteristic length is, if the file of the rig has none."""
ORIENTATION_WORKSPACES: tuple[Literal["total", "inclusive"], ...] = ("total", "inclusive")
ORIENTATION_HEADINGS = ("<rig", "<metric", "in all orientations\n(total)", "in one at least\n(inclusive)")
WITHOUT_STORE = "no values are kept; with --out DIR.zarr, the same command goes on where it was"
"""What Ctrl-C leaves to say."""
STEPS = 40
"""Along the longest edge of the box, if no step is given."""
STORE_SUFFIX = ".zarr"


@options.checked
def _output(path: Path) -> None:
    """Check that a sweep, or a proof, can be written there."""
    proof = path.suffix.lower() == PROOF_SUFFIX
    (options.output_file(PROOF_SUFFIX) if proof else options.output_folder(STORE_SUFFIX))(path)


class View(StrEnum):
    """What a picture shows."""

    slices = "slices"
    volume = "volume"
    shares = "shares"


def workspace(
    rigs: Annotated[list[str], options.rig_argument()],
    box: Annotated[
        str | None,
        typer.Option(
            metavar="X0 X1 Y0 Y1 Z0 Z1",
            help="Box of positions in m; Z0 = Z1 is a plane. Left out: the box around all anchors and homes.",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            metavar="STEP",
            help=f"Distance between positions in m: one, or one for each axis. Left out: {STEPS} steps along the "
            "longest edge.",
        ),
    ] = None,
    rotations: Annotated[
        str | None,
        typer.Option(
            metavar="SET",
            help="Orientations at every position of the box, in degrees: cone:10, how far the axis that points "
            "up is tilted; rpy:-10..10,0,-30..30, roll, pitch and yaw about x, y and z; in the plane "
            "angle:-30..30; each with :STEP, 5 if left out. Or a file (.csv): rx, ry, rz, axis times angle, rad.",
            show_default=False,
        ),
    ] = None,
    poses: Annotated[
        Path | None,
        typer.Option(help="File of poses in place of a box (.csv, .parquet, .npz).", show_default=False),
    ] = None,
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
        typer.Option(
            "--out",
            "-o",
            metavar="DIR.zarr",
            callback=_output,
            help="Write all values to this folder; with --certify, what is proved to a file NAME.npz. The same "
            "command continues what was killed.",
            show_default=False,
        ),
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Evaluate on a Dask cluster, tcp://HOST:PORT.", show_default=False)
    ] = None,
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
    certify: Annotated[
        bool,
        typer.Option(
            "--certify",
            help="Prove in which cells of the box a rig renders what is required, in all orientations, and in "
            "which it does not; wrench closure if nothing is required. STEP is the longest edge of the finest.",
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Evaluate where, and how well, rigs can pull.

    At every position of a box, or at the poses of a file. Platforms keep their home orientation in a box, unless
    there are rotations: then a second table has how much of it is feasible in all of them, the total orientation
    workspace, which is drawn, and in one at least, the inclusive one.
    """
    loaded = [options.with_frames(load_rig(path), frames) for path in rigs]
    loaded = [with_requirement(rig, wrench, gravity, required) for rig in loaded]
    if certify:
        unfit = {"--poses": poses, "--metric": metrics, "--view": view != View.slices}
        if given := [option for option, value in unfit.items() if value]:
            raise typer.BadParameter(f"--certify proves what is required, in a box; leave {given[0]} out")
        if len(loaded) > 1:
            raise typer.BadParameter(f"--certify proves one rig at a time; there are {len(loaded)}")
    if out is not None and (out.suffix.lower() == PROOF_SUFFIX) != certify:
        suffix = PROOF_SUFFIX if certify else STORE_SUFFIX
        raise typer.BadParameter(f"--out: {out}: the name must end in {suffix}")
    if certify:
        ends, steps = _region(loaded, box, step)
        turns = None if rotations is None else _rotations(loaded[0], rotations)
        workspace_proof.prove(loaded[0], ends, steps, turns, out=out, scheduler=scheduler, plot=plot, json=json)
        return
    if poses is not None and (box or step or rotations):
        raise typer.BadParameter("--poses takes the place of --box, --step and --rotations; leave one out")
    if poses is not None and plot is not None:
        raise typer.BadParameter("--plot draws a box, not the poses of a file; leave one out")
    where = _box(loaded, box, step, rotations) if poses is None else read_poses(poses)
    places = {name: place for rig in loaded for name, place in rig.at_rest.items()}
    named = options.parse_names(metrics)
    names = _default_metrics(loaded) if named is None else named
    go_on = WITHOUT_STORE if out is None else f"the same command goes on with what is in {out}"
    with output.if_interrupted(go_on), output.ResultWriter(quiet=json) as writer:
        try:
            data = sweep(loaded, where, names, frames=places, out=out, scheduler=scheduler)
        except OSError as error:  # as Zarr has it, without the name of a file
            if out is None:
                raise
            raise unwritable(out, error) from None
        summarised = summary(data)
        found = summarised.rows
        turned = {kind: over_orientations(data, kind) for kind in ORIENTATION_WORKSPACES} if rotations else {}
        shares = {kind: [each.above_zero for *_, each in summary(part).rows] for kind, part in turned.items()}
        if plot is not None:
            from tensionlab import plots

            drawn = names[0] if metrics else DRAWN_METRIC
            draw: Callable[..., Any] = getattr(plots, f"plot_{view}")
            writer.write(
                "plot", plot, lambda path: plots.save_figure(draw(turned.get("total", data), metric=drawn), path)
            )
        if json:
            output.print_json(
                poses=found[0][-1].poses,
                out=None if out is None else str(out),
                rows=[
                    {"rig": rig, "metric": name, "unit": unit, **dataclasses.asdict(values)}
                    | {f"{kind}_above_zero": each[index] for kind, each in shares.items()}
                    for index, (rig, name, unit, values) in enumerate(found)
                ],
                manifest=json_text.loads(data.manifest),
            )
        else:
            _print(summarised, where, out)
            _print_orientations(found, shares)
            _print_requirements(loaded)


def _default_metrics(rigs: list[Rig]) -> list[str]:
    """Return the metrics if none is named: with whether what is required is feasible, if anything is."""
    return ["wrench-feasible", *DEFAULT_METRICS] if any(rig.required for rig in rigs) else DEFAULT_METRICS


def _print_requirements(rigs: list[Rig]) -> None:
    """Print what is required of each rig, and at which arm its torques count as forces."""
    console = output.console()
    for rig in rigs:
        if rig.required:
            console.print(f"required of {rig.name}: {rig.required.describe(rig)}", style="dim", soft_wrap=True)
        if rig.n > rig.dimension:
            text = f"torques of {rig.name} count as forces at {rig.characteristic_length:.3g} m in margins"
            own = rig.required.length is not None
            console.print(f"{text}, {'as required' if own else ROOT_MEAN_SQUARE}", style="dim", soft_wrap=True)


def _print_orientations(
    found: Sequence[tuple[str, str, str, Summary]], shares: Mapping[Literal["total", "inclusive"], list[float]]
) -> None:
    """Print in which share of the volume a metric is above zero in all orientations, and in one at least."""
    if shares:
        rows = [
            (rig, name, *(f"{100 * shares[kind][index]:.1f} %" for kind in ORIENTATION_WORKSPACES))
            for index, (rig, name, *_) in enumerate(found)
            if make(name).above_zero
        ]
        output.console().print()
        output.print_table("Above 0 in this share of the volume:", ORIENTATION_HEADINGS, rows)


def _box(rigs: list[Rig], box: str | None, step: str | None, rotations: str | None) -> Grid:
    """Return the poses of the sweep."""
    ends, steps = _region(rigs, box, step)
    turns = None if rotations is None else _rotations(rigs[0], rotations)
    return box_of_poses(*ends, step=steps if len(steps) > 1 else steps[0], rotations=turns)


def _rotations(rig: Rig, text: str) -> Floats:
    """Return the orientations at every position."""
    up = rig.upward if rig.up else np.eye(rig.dimension)[-1]
    return parse_rotations(text, rig.dimension, up)


def _region(rigs: list[Rig], box: str | None, step: str | None) -> tuple[Floats, list[float]]:
    """Return where the box starts and ends along each axis, and its steps: one, or one for each axis."""
    dimension = rigs[0].dimension
    if box is None:
        points = np.concatenate([[rig.home, *rig.anchors] for rig in rigs if rig.dimension == dimension])
        ends = np.stack([points.min(axis=0), points.max(axis=0)], axis=-1)
    else:
        numbers = options.parse_numbers("--box", box)
        if len(numbers) != 2 * dimension:
            names = " ".join(f"{axis}0 {axis}1" for axis in "xyz"[:dimension])
            raise typer.BadParameter(
                f"--box has {format_count(len(numbers), 'number')}; {rigs[0].name} needs {2 * dimension}: {names}"
            )
        ends = np.array(numbers).reshape(dimension, 2)
    if step is None:
        steps = [float(np.ptp(ends, axis=1).max()) / STEPS or 1.0]
    else:
        steps = options.parse_numbers("--step", step)
    return ends, steps


def _print(summarised: SweepSummary, where: Grid | PoseList, out: Path | None) -> None:
    """Print a row for each rig and metric, then what the metrics mean."""
    found = summarised.rows
    metrics = {name: make(name) for _, name, *_ in found}
    rows = []
    for index, (rig, name, unit, each) in enumerate(found):
        first = "" if index and rig == found[index - 1][0] else rig
        values = map(output.short, (each.min, each.median, each.max))
        above = f"{100 * each.above_zero:.1f} %" if metrics[name].above_zero else ""
        missing = f"{each.missing:,}" if each.missing else ""
        rows.append((first, name, "" if unit == "1" else unit, *values, above, missing))
    axes = [each for each in where.coordinates() if each.name in "xyz"]
    region = ", ".join(f"{each.name} {each.values.min():g} to {each.values.max():g} m" for each in axes)
    poses = found[0][-1].poses
    places = math.prod(len(each.values) for each in axes) if isinstance(where, Grid) else poses
    turns = f", {places:,} positions in {poses // places} orientations" if poses > places else ""
    apart = f", {summarised.step}" if summarised.step else ""
    output.print_table(f"{poses:,} poses{turns}{apart}: {region}", SUMMARY_HEADINGS, rows)
    console = output.console()
    console.print()
    for name, metric in metrics.items():
        meaning = f" Above 0: {metric.above_zero}." if metric.above_zero else ""
        console.print(f"{name}: {description(metric)}{meaning}", style="dim")
    if summarised.step and any(metric.above_zero for metric in metrics.values()):
        console.print(f"above 0: share of the volume, estimated from positions {summarised.step}", style="dim")
    if any(each.missing for *_, each in found):
        console.print(
            "no value: a cable has no length there, or a force whose effort is evaluated is infeasible",
            style="dim",
        )
    if found[0][-1].poses > MEDIAN_SAMPLE:
        console.print(f"median: of an even selection of {MEDIAN_SAMPLE:,} values at most", style="dim")
    if out:
        console.print(f"values: {out}", soft_wrap=True)
