"""``tensionlab rig``: what a rig is, and whether it can work."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli import output

if TYPE_CHECKING:
    from tensionlab.model.rig import Rig

rig = typer.Typer(help="Show a rig, or check that it can work.", no_args_is_help=True, rich_markup_mode=None)
RigFile = Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML).", show_default=False)]
Plot = Annotated[
    Path | None, typer.Option(callback=output.picture_file, help="Draw to this file (png, pdf, svg).")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")]


@rig.command()
def show(path: RigFile, plot: Plot = None, json: Json = False) -> None:
    """Show the modules of a rig: anchors, cables at home, limits. Body frames stay at rest."""
    from tensionlab.experiments.comparison import at_rest

    loaded = _load(path, plot)
    lengths = loaded.lengths(loaded.home, frames=at_rest(loaded))
    if json:
        output.print_json(
            {
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
        )
        return
    console = output.console()
    if loaded.description:
        console.print(loaded.description, markup=False)
    if loaded.source:
        console.print(f"Source: {loaded.source}", markup=False)
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
    if plot:
        console.print(f"plot: {plot}", soft_wrap=True)


@rig.command()
def check(path: RigFile, plot: Plot = None, json: Json = False) -> None:
    """Check that a rig can work at home: rank, limits, balance, strength. Exit status 1 where it cannot.

    Body frames stay at rest, at the origin of the world.
    """
    from tensionlab.experiments.checks import check_rig

    loaded = _load(path, plot)
    findings = check_rig(loaded)
    passed = all(finding.passed is not False for finding in findings)
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
        console = output.console()
        frames = ", with its body frames at rest" if loaded.frames else ""
        grid = output.table(f"{loaded.name} {'can' if passed else 'cannot'} work at home{frames}")
        for heading in ("", "check", "finding"):
            grid.add_column(heading, no_wrap=heading != "finding")
        words = {True: "[green]yes[/green]", False: "[red]no[/red]", None: "note"}
        for finding in findings:
            grid.add_row(words[finding.passed], finding.name, finding.text)
        console.print(grid)
        if plot:
            console.print(f"plot: {plot}", soft_wrap=True)
    raise typer.Exit(0 if passed else 1)


def _load(path: Path, plot: Path | None) -> Rig:
    """Read a rig, and draw it if asked to."""
    from tensionlab.model.files import load_rig

    loaded = load_rig(path)
    if plot:
        from tensionlab.plots import plot_rig

        plot_rig(loaded, plot)
    return loaded
