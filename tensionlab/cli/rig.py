"""``tensionlab rig``: what a rig is, whether it can work, and how it comes and goes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import output
from tensionlab.files import writing

if TYPE_CHECKING:
    from tensionlab.arrays import Floats
    from tensionlab.model.rig import Rig
    from tensionlab.validation.rig_check import Finding

rig = typer.Typer(help="Show, check, import and export rigs.", no_args_is_help=True, rich_markup_mode=None)
RigFile = Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML).", show_default=False)]
Plot = Annotated[
    Path | None, typer.Option(callback=output.picture_file, help="Draw to this file (png, pdf, svg).")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")]


@rig.command()
def show(path: RigFile, plot: Plot = None, json: Json = False) -> None:
    """Show the modules of a rig: anchors, cables at home, limits. Body frames stay at rest."""
    from tensionlab.model.files import load_rig

    loaded = load_rig(path)
    lengths = loaded.lengths(loaded.home, frames=loaded.at_rest)
    with output.Keeper(quiet=json) as keeper:
        if plot:
            keeper.write("plot", plot, lambda picture: _draw(loaded, picture))
        if json:
            output.print_json(_plain(loaded, lengths))
        else:
            _show(loaded, lengths)


def _plain(loaded: Rig, lengths: Floats) -> dict[str, object]:
    return {
        "rig": loaded.name,
        "kind": loaded.kind,
        "components": loaded.n,
        "home": loaded.home,
        "frames": loaded.frames,
        "modules": [
            {
                "name": module.name,
                "frame": module.frame,
                "anchor": module.anchor,
                "attachment": module.attachment,
                "length_at_home": length,
                "lower": module.lower,
                "upper": module.upper,
                "brake": module.brake,
            }
            for module, length in zip(loaded.modules, lengths, strict=True)
        ],
    }


def _show(loaded: Rig, lengths: Floats) -> None:
    console = output.console()
    if loaded.description:
        console.print(loaded.description)
    if loaded.source:
        console.print(f"Source: {loaded.source}")
    console.print()
    where = f"home {output.vector(loaded.home)} m"
    grid = output.table(f"{loaded.name}: {loaded.kind} rig, {loaded.m} cables, {loaded.n} components, {where}")
    grid.add_column("module")
    for heading in (
        "frame",
        "anchor\nm",
        "attachment\nm",
        "cable at\nhome m",
        "lower\nN",
        "upper\nN",
        "brake\nN",
    ):
        grid.add_column(heading, justify="left" if heading == "frame" else "right", no_wrap=True)
    for module, length in zip(loaded.modules, lengths, strict=True):
        grid.add_row(
            module.name,
            module.frame,
            output.vector(module.anchor),
            output.vector(module.attachment),
            f"{length:.3f}",
            f"{module.lower:g}",
            f"{module.upper:g}",
            "–" if module.brake is None else f"{module.brake:g}",
        )
    console.print(grid)


@rig.command()
def check(path: RigFile, plot: Plot = None, json: Json = False) -> None:
    """Check that a rig can work at home: rank, limits, balance, strength. Exit status 1 where it cannot.

    Body frames stay at rest, at the origin of the world.
    """
    from tensionlab.model.files import load_rig
    from tensionlab.validation.rig_check import check_rig

    loaded = load_rig(path)
    findings = check_rig(loaded)
    passed = all(finding.passed is not False for finding in findings)
    with output.Keeper(quiet=json) as keeper:
        if plot:
            keeper.write("plot", plot, lambda picture: _draw(loaded, picture))
        if json:
            output.print_json(
                {
                    "rig": loaded.name,
                    "passed": passed,
                    "checks": [
                        {"check": finding.name, "passed": finding.passed, "finding": finding.text}
                        for finding in findings
                    ],
                }
            )
        else:
            _show_findings(loaded, findings, passed)
    raise typer.Exit(0 if passed else 1)


def _show_findings(loaded: Rig, findings: Sequence[Finding], passed: bool) -> None:
    from rich.text import Text

    frames = ", with its body frames at rest" if loaded.frames else ""
    grid = output.table(f"{loaded.name} {'can' if passed else 'cannot'} work at home{frames}")
    for heading in ("", "check", "finding"):
        grid.add_column(heading, no_wrap=heading != "finding")
    words = {True: Text("yes", "green"), False: Text("no", "red"), None: Text("note")}
    for finding in findings:
        grid.add_row(words[finding.passed], finding.name, finding.text)
    output.console().print(grid)


@rig.command("import")
def import_(
    caspr: Annotated[
        tuple[Path, Path],
        typer.Option(metavar="BODIES.xml CABLES.xml", help="The two files of a CASPR model.", show_default=False),
    ],
    cable_set: Annotated[
        str | None,
        typer.Option("--set", metavar="ID", help="Which set of cables; the file's default if left out."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="RIG", callback=output.output_file(".toml"), help="Write the rig file here, not to stdout."
        ),
    ] = None,
) -> None:
    """Make a rig file of a model of CASPR, the cable-robot library; one body that moves in a plane or in space."""
    from tensionlab.model.caspr import load_caspr
    from tensionlab.model.files import rig_to_toml, save_rig

    imported = load_caspr(*caspr, cable_set)
    if out is None:
        typer.echo(rig_to_toml(imported), nl=False)
        return
    save_rig(imported, out)
    console = output.console()
    console.print(imported.description)
    console.print(f"rig: {out}, {imported.kind}, {imported.m} cables", soft_wrap=True)


@rig.command()
def export(
    path: RigFile,
    mjcf: Annotated[
        Path,
        typer.Option(
            metavar="FILE.xml",
            callback=output.output_file(".xml"),
            help="Write a MuJoCo model here.",
            show_default=False,
        ),
    ],
) -> None:
    """Write a rig as a MuJoCo model: a spatial tendon for each cable, with a motor that can only pull."""
    from tensionlab.model.files import load_rig
    from tensionlab.model.mjcf import rig_to_mjcf

    loaded = load_rig(path)
    writing.write_text(mjcf, rig_to_mjcf(loaded))
    output.console().print(f"model: {mjcf}, {loaded.m} tendons", soft_wrap=True)


def _draw(loaded: Rig, path: Path) -> None:
    from tensionlab.plots import plot_rig

    plot_rig(loaded, path)
