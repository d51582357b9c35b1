"""``tensionlab rig``: show, check, import and export rigs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, Verbs, option
from tensionlab.interop import caspr as caspr_models
from tensionlab.interop.mjcf import rig_to_mjcf
from tensionlab.model.files import load_rig, rig_to_toml, save_rig
from tensionlab.model.module import WORLD
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.files import writing
from tensionlab.support.table import Column, Table, findings_table
from tensionlab.validation.rig_check import check_losses, check_rig, losses_table
from tensionlab.workspace.interference import body_distances

rig = Verbs("Show, check, import and export rigs.")


@rig.command()
def show(
    path: options.RigArgument, frames: options.BodyFrames = None, plot: options.Plot = None, json: Json = False
) -> None:
    """Show anchors, cable lengths at home, limits and bodies of a rig."""
    loaded = options.load(path, frames)
    distances = body_distances(loaded, loaded.home, frames=loaded.at_rest)
    smallest_distances = distances.min(axis=0)
    lengths = loaded.lengths(loaded.home, frames=loaded.at_rest)
    with output.ResultWriter(quiet=json) as writer:
        writer.draw(plot, "rig", loaded)
        if json:
            output.print_json(
                rig=loaded.name,
                kind=loaded.kind,
                components=loaded.n,
                home=loaded.home,
                frames=loaded.frames,
                modules=[
                    vars(module) | {"length_at_home": length}
                    for module, length in zip(loaded.modules, lengths, strict=True)
                ],
                bodies=[
                    vars(body) | {"shape": body.shape, "distance_at_home": distance}
                    for body, distance in zip(loaded.bodies, smallest_distances, strict=True)
                ],
            )
        else:
            table = loaded.table()
            if loaded.source:
                table.notes.append(f"Source: {loaded.source}")
            output.print_table(table)
            if loaded.bodies:
                output.print_line()
                output.print_table(_bodies_table(loaded, distances))


def _bodies_table(loaded: Rig, distances: Floats) -> Table:
    """Return the bodies of a rig, and the cable that is nearest to each at home, from distances (m, bodies)."""
    nearest = zip(loaded.bodies, distances.min(axis=0), distances.argmin(axis=0), strict=True)
    rows = [
        [body.name, body.describe(), body.frame if body.frame != WORLD else None, body.margin, body.sway or None,
         distance, loaded.modules[cable].name]
        for body, distance, cable in nearest
    ]  # fmt: skip
    columns = ["body", "shape", "frame", Column("margin", "m"), Column("sway", "m"),
               Column("nearest cable at home", "m", ".3f"), "its module"]  # fmt: skip
    return Table(columns, rows, "Bodies that cables must stay clear of")


@rig.command()
def check(
    path: options.RigArgument,
    wrench: options.Wrench = None,
    gravity: options.Gravity = None,
    required: options.Required = None,
    frames: options.BodyFrames = None,
    plot: options.Plot = None,
    json: Json = False,
) -> None:
    """Check that a rig can work at its home, and what is left after the loss of a module.

    Checks rank, limits, what is required, balance, strength and the clearance of bodies; exit status 1 where it
    cannot. A loss does not count for that.
    """
    loaded = options.load(path, frames, wrench, gravity, required)
    findings, losses = check_rig(loaded), check_losses(loaded)
    passed = all(finding.passed is not False for finding in findings)
    with output.ResultWriter(quiet=json) as writer:
        writer.draw(plot, "rig", loaded)
        if json:
            checks = [
                {"check": finding.name, "passed": finding.passed, "finding": finding.text} for finding in findings
            ]
            output.print_json(
                rig=loaded.name, passed=passed, checks=checks, losses=[loss._asdict() for loss in losses]
            )
        else:
            where = "home, with its body frames at rest" if loaded.frames else "home"
            title = f"{loaded.name} {'can' if passed else 'cannot'} work at {where}"
            output.print_table(findings_table(title, findings))
            if losses:
                output.print_line()
                output.print_table(losses_table(loaded, losses))
    raise typer.Exit(0 if passed else 1)


@rig.command("import")
def import_(
    caspr: Annotated[tuple[Path, Path], option("BODIES.xml CABLES.xml", "The two files of a CASPR model.")],
    cable_set: Annotated[
        str | None, option("ID", "Set of cables; the file's default if left out.", "--set")
    ] = None,
    out: Annotated[
        Path | None, options.writes("Write the rig here, not to stdout.", ".toml", metavar="RIG")
    ] = None,
) -> None:
    """Make a rig file from a model of CASPR, a cable-robot library.

    It has one body that moves in a plane or in space.
    """
    imported = caspr_models.load_caspr(*caspr, cable_set)
    if out is None:
        typer.echo(rig_to_toml(imported), nl=False)
        return
    save_rig(imported, out)
    output.print_line(imported.description)
    output.print_line(f"rig: {out}, {imported.kind}, {imported.m} cables")


@rig.command()
def export(
    path: options.RigArgument,
    out: Annotated[Path, options.writes("Write a MuJoCo model here.", ".xml", metavar="FILE.xml")],
) -> None:
    """Write a rig as a MuJoCo model.

    It has a spatial tendon for each cable, with a motor that can only pull.
    """
    loaded = load_rig(path)
    writing.write_text(out, rig_to_mjcf(loaded))
    output.print_line(f"model: {out}, {loaded.m} tendons")
