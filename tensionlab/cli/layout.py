"""``tensionlab layout``: where to put the modules."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, Verbs, flag, option
from tensionlab.support.files import writing
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.results import Layout
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
            "Write the rig here; of several numbers of modules, RIG-4.toml, ...", ".toml", metavar="RIG"
        ),
    ] = None,
    wrench: options.Wrench = None,
    gravity: options.Gravity = None,
    required: options.Required = None,
    seed: Annotated[int | None, option("N", "Seed in place of the file's.", min=0)] = None,
    certify: Annotated[bool, flag("--certify", "Prove what the layouts render everywhere in the target.")] = False,
    plot: options.Plot = None,
    json: Json = False,
) -> None:
    """Search for the best places of modules.

    On walls, floors and bodies, so that they render the most force or the stiffest walls, and no cable comes close
    to a person. The space file says where modules may stand, how many there are, where the hand will be, and what
    counts.
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
        result = task.run(certify=certify, progress=progress)
    best = result.best
    with output.ResultWriter(quiet=json) as writer:
        written = [
            str(files[layout.rig.m])
            for layout in result.layouts
            if files and writer.write_text(layout.rig.name, files[layout.rig.m], layout.to_toml())
        ]
        writer.draw(plot, "search", task.space, task.target, result)
        if json:
            layouts = [_layout_json(layout, on_front=layout in result.front) for layout in result.layouts]
            output.print_json(space=task.name, score=result.describe(), layouts=layouts, written=written,
                              manifest=output.manifest(task.seed))  # fmt: skip
        else:
            if len(result.layouts) > 1:
                table = result.table()
                table.title = task.name
                output.print_table(table)
                output.print_line()
            table = best.table()
            table.title = f"{best.rig.name} {result.objective.describe(best.rig, best.score)}"
            table.notes = [f"{layout.rig.name}: {note}" for layout in result.layouts for note in layout.notes]
            output.print_table(table)
    if problem := _shortfall(best, result.objective):
        output.print_error(problem)
        raise typer.Exit(1)


def _layout_json(found: Layout, on_front: bool) -> dict[str, object]:
    ends = ["anchor", "attachment"] if found.rig.n > found.rig.dimension else ["anchor"]
    return {
        "rig": found.rig.name,
        "score": found.score,
        "worst_margin": found.worst,
        "proved_force": found.proved,
        "nearest_body": None if found.nearest is None else found.nearest._asdict(),
        "on_front": on_front,
        "modules": [
            output.fields(module, "name", "frame", *ends, "lower", "upper") | {"contribution": lost}
            for module, lost in zip(found.rig.modules, found.contributions, strict=True)
        ],
    }


def _shortfall(best: Layout, objective: Objective) -> str:
    """Return what the best layout does not have, or not provably, and what to do; empty if it has all."""
    if best.nearest is not None and not best.clear:
        near = f"no layout was found whose cables stay clear of bodies; closest: {best.nearest.describe()}"
        return f"{near}; move the person or the target, or give other surfaces"
    advice = (
        "give more modules (counts), higher limits, a smaller target, or a longer search (generations, starts)"
    )
    if best.score <= 0:
        held = best.rig.required.describe(best.rig) if best.rig.required else "a force in every direction"
        wanted = objective.desired(best.rig)
        where = "everywhere in the target" if objective.level is None else f"with {wanted} anywhere"
        what = f"no layout was found that holds {held} {where}: the worst margin is {best.worst:.4g} N"
        return f"{what}; {advice}"
    force = objective.force or 0.0
    if best.proved is None or best.proved >= force:
        return ""
    held = f"{best.proved:.4g} N is, {force - best.proved:.2g} N less" if best.proved >= 0 else "no force is"
    where = objective.where(best.rig)
    return f"{force:g} N {where} is not proved everywhere in the target: of {best.rig.name} {held}; {advice}"
