"""``tensionlab layout``: where to put the modules."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import output
from tensionlab.files import writing

if TYPE_CHECKING:
    from tensionlab.workspace.layout.result import Layout, LayoutSearch

layout = typer.Typer(help="Find out where to put the modules.", no_args_is_help=True, rich_markup_mode=None)


@layout.callback()
def group() -> None:
    """Keep ``search`` a word of its own, although it is the only verb."""


@layout.command()
def search(
    path: Annotated[Path, typer.Argument(metavar="SPACE", help="Space file (TOML).", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="RIG",
            callback=output.output_file(".toml"),
            help="Write the rig here; for several numbers of modules, one file each: RIG-4.toml, ...",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed in place of the file's.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Search for the places on walls, floors and bodies from which modules render the most force.

    The file says where modules may stand, how many there are, where the hand will be, and what counts.
    """
    from tensionlab.records import manifest
    from tensionlab.workspace.layout.task import load_task

    task = load_task(path)
    if seed is not None:
        task = task._replace(seed=seed)
    counts = [count + len(task.space.fixed) for count in task.space.counts]
    files = {} if out is None else _files(out, counts)
    for file in files.values():
        writing.require_writable(file)
    with output.progress("Layouts") as tell:
        found = task.run(tell)
    with output.Keeper(quiet=json) as keeper:
        kept = [
            str(files[each.rig.m])
            for each in found.layouts
            if files and keeper.write_text(each.rig.name, files[each.rig.m], each.to_toml())
        ]
        if json:
            output.print_json(
                {
                    "space": task.name,
                    "score": found.objective.describe(),
                    "layouts": [_plain(each, on_front=each in found.front) for each in found.layouts],
                    "written": kept,
                    "manifest": manifest(["tensionlab", *sys.argv[1:]], task.seed),
                }
            )
        else:
            _print(found, task.name)


def _files(out: Path, counts: Sequence[int]) -> dict[int, Path]:
    """Return a file for each number of modules."""
    return {count: out.with_stem(f"{out.stem}-{count}") if len(counts) > 1 else out for count in counts}


def _plain(found: Layout, on_front: bool) -> dict[str, object]:
    return {
        "rig": found.rig.name,
        "score": found.score,
        "worst_margin": found.worst,
        "on_front": on_front,
        "modules": [
            {
                "name": module.name,
                "frame": module.frame,
                "anchor": module.anchor,
                "lower": module.lower,
                "upper": module.upper,
                "contribution": lost,
            }
            for module, lost in zip(found.rig.modules, found.contributions, strict=True)
        ],
    }


def _print(found: LayoutSearch, name: str) -> None:
    """Print what each number of modules buys, and where the modules of the best layout stand."""
    console = output.console()
    if len(found.layouts) > 1:
        console.print(f"{name}: the score is {found.objective.describe()}", soft_wrap=True)
        front = output.table()
        for heading in ("modules", "score", "worst\nmargin N", "beats fewer"):
            front.add_column(heading, justify="left" if heading == "beats fewer" else "right")
        for each in found.layouts:
            better = "yes" if each in found.front else "no"
            front.add_row(str(each.rig.m), f"{each.score:.4g}", f"{each.worst:.4g}", better)
        console.print(front)
        console.print()
    best = found.best
    title = f"{best.rig.name}: {best.score:.4g} is {found.objective.describe()}"
    console.print(title, soft_wrap=True)
    grid = output.table()
    for heading in ("module", "frame", "anchor\nm", "score lost\nwithout it"):
        grid.add_column(heading, justify="left" if heading in ("module", "frame") else "right", no_wrap=True)
    for module, lost in zip(best.rig.modules, best.contributions, strict=True):
        grid.add_row(module.name, module.frame, output.vector(module.anchor.round(4) + 0.0), f"{lost:.4g}")
    console.print(grid)
