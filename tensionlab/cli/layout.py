"""``tensionlab layout``: where to put the modules."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.options import Gravity, Plot, Required, Wrench
from tensionlab.cli.common.verbs import Json, Verbs
from tensionlab.support.files import writing
from tensionlab.workspace.layout.results import Layout, LayoutSearch
from tensionlab.workspace.layout.task import load_task

layout = Verbs("Find out where to put the modules.")


@layout.callback()
def group() -> None:
    """Keep ``search`` a word of its own, although it is the only verb."""


@layout.command()
def search(
    space: Annotated[str, options.stored_argument("spaces", "SPACE")],
    out: Annotated[
        Path | None,
        options.writes(
            "Write the rig here; for several numbers of modules, one file each: RIG-4.toml, ...",
            ".toml",
            metavar="RIG",
        ),
    ] = None,
    wrench: Wrench = None,
    gravity: Gravity = None,
    required: Required = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed in place of the file's.")] = None,
    certify: Annotated[
        bool,
        typer.Option(
            "--certify", help="Prove what the layouts render everywhere in the target, not at its points alone."
        ),
    ] = False,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Search for the best places of modules.

    On walls, floors and bodies, so that they render the most force. The space file says where modules may stand,
    how many there are, where the hand will be, and what counts.
    """
    task = load_task(space)
    if seed is not None:
        task = task._replace(seed=seed)
    rig = options.with_requirement(task.space.one_module, wrench, gravity, required)
    task = task._replace(space=replace(task.space, required=rig.required))
    counts = [count + len(task.space.fixed) for count in task.space.counts]
    files: dict[int, Path] = {}
    if out is not None:
        files = {count: out.with_stem(f"{out.stem}-{count}") if len(counts) > 1 else out for count in counts}
    for file in files.values():
        writing.require_writable(file)
    with output.progress("Layouts") as progress:
        found = task.run(progress, certify=certify)
    with output.ResultWriter(quiet=json) as writer:
        written = [
            str(files[each.rig.m])
            for each in found.layouts
            if files and writer.write_text(each.rig.name, files[each.rig.m], each.to_toml())
        ]
        writer.draw(plot, "search", task.space, task.target, found)
        if json:
            output.print_json(
                space=task.name,
                score=found.describe(),
                layouts=[_plain(each, on_front=each in found.front) for each in found.layouts],
                written=written,
                manifest=output.manifest(task.seed),
            )
        else:
            _print(found, task.name)
    if found.best.score <= 0:
        output.print_error(
            f"no layout was found that holds {_aim(found)}: the worst margin is {found.best.worst:.4g} N; give "
            "more modules (counts), higher limits or a smaller target, or search longer (generations, starts)"
        )
        raise typer.Exit(1)
    proved, force = found.best.proved, found.objective.force or 0.0
    if proved is not None and not proved >= force:
        held = f"{proved:.4g} N is, {force - proved:.2g} N less" if proved >= 0 else "no force is"
        output.print_error(
            f"{force:g} N in every direction is not proved everywhere in the target: of {found.best.rig.name} "
            f"{held}; give more modules (counts), higher limits or a smaller target, or search longer "
            "(generations, starts)"
        )
        raise typer.Exit(1)


def _aim(found: LayoutSearch) -> str:
    """Return in a few words what a layout has to hold, at the least."""
    required = found.best.rig.required
    held = required.describe(found.best.rig) if required else "a force in every direction"
    force = found.objective.force
    return (
        f"{held} everywhere in the target"
        if force is None
        else f"{held} with {force:g} N in every direction anywhere"
    )


def _plain(found: Layout, on_front: bool) -> dict[str, object]:
    return {
        "rig": found.rig.name,
        "score": found.score,
        "worst_margin": found.worst,
        "proved_force": found.proved,
        "on_front": on_front,
        "modules": [
            output.fields(module, "name", "frame", "anchor", "lower", "upper") | {"contribution": lost}
            for module, lost in zip(found.rig.modules, found.contributions, strict=True)
        ],
    }


def _print(found: LayoutSearch, name: str) -> None:
    """Print what each number of modules gains, and where the modules of the best layout stand."""
    console = output.console()
    if len(found.layouts) > 1:
        console.print(name)
        output.print_table(found.table())
        console.print()
    best = found.best
    table = best.table()
    table.title = f"{best.rig.name} {found.objective.rendered(best.score, best.rig)}"
    output.print_table(table)
    for each in found.layouts:
        if each.proved is not None:
            about = f" about {each.rig.required.describe(each.rig)}" if each.rig.required else ""
            held = "nothing" if np.isnan(each.proved) else f"{each.proved:.4g} N in every direction{about}"
            console.print(f"{each.rig.name}: proved everywhere in the target: {held}", soft_wrap=True)
