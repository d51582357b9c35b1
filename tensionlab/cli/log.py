"""``tensionlab log``: what is in the log of a run, and what other solvers would have made of it."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.score_table import Column, print_scores

if TYPE_CHECKING:
    from rich.table import Table

    from tensionlab.comparison.replay import ReplayRow
    from tensionlab.hardware.log.reader import Run
    from tensionlab.hardware.log.report import ModuleReport, RunReport

log = typer.Typer(help="Show, export, draw and replay logs of runs.", no_args_is_help=True, rich_markup_mode=None)
RunFile = Annotated[Path, typer.Argument(metavar="RUN", help="Log of a run (*.mcap).", show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")]
EVENTS = 12
"""So many events are printed at most; JSON has all."""

COLUMNS: list[Column[ReplayRow]] = [
    ("repl", lambda row: str(row.replaced), False),
    ("error\nmean N", lambda row: output.short(row.residual_mean), False),
    ("error\nmax N", lambda row: output.short(row.residual_max), True),
    ("angle\nmax °", lambda row: output.short(row.angle_max_deg), True),
    ("size\nmax N", lambda row: output.short(row.magnitude_max), False),
    ("mean t²\nN²", lambda row: output.short(row.tension_sq_mean), True),
    ("t max\nN", lambda row: output.short(row.tension_max), False),
    ("jump\nmax N", lambda row: output.short(row.jump_max), True),
    ("iter\nmean", lambda row: output.short(row.iterations_mean), False),
    ("iter\nmax", lambda row: output.short(row.iterations_max), False),
]
"""Of the table of solvers, those after the statuses."""

LEGEND = """\
exact: limits kept, wrench rendered   near: proved out of reach, the policy's best substitute found
limit: neither proved   fail: the solver broke   repl: unproved, so that the exact solver's answer is counted here
error: desired minus rendered   angle, size: between the two forces, and of one without the other
t: tensions   jump: of a tension from one cycle to the next, before the runner slows it"""


@log.command()
def info(path: RunFile, json: Json = False) -> None:
    """Show how a run went: what it rendered, how punctual it was, what held the modules back."""
    from tensionlab.hardware.log.report import report

    run = _read(path)
    found = report(run)
    if json:
        output.print_json(
            {**dataclasses.asdict(found), "setup": dataclasses.asdict(run.setup), "manifest": run.manifest}
        )
    else:
        _print_info(found)


@log.command()
def export(
    path: RunFile,
    to: Annotated[
        Path,
        typer.Option(
            callback=output.output_file(".nc", ".parquet"),
            help="Write to this file: NetCDF (.nc) or Parquet.",
            show_default=False,
        ),
    ],
) -> None:
    """Write a run as NetCDF, with names, units and dimensions, or as a Parquet table with a row for each cycle."""
    from tensionlab import records
    from tensionlab.hardware.log.reader import flat_columns, write_netcdf

    run = _read(path)
    if to.suffix.lower() == ".nc":
        write_netcdf(run, to)
    else:
        records.write_parquet(to, flat_columns(run), run.manifest)
    typer.echo(f"{to}: {len(run)} cycles")


@log.command()
def plot(
    path: RunFile,
    file: Annotated[
        Path,
        typer.Option(
            "--plot", callback=output.picture_file, help="Draw to this file (png, pdf, svg).", show_default=False
        ),
    ],
) -> None:
    """Draw a run: wrenches, tensions, what was proved and what held the modules back, and how punctual it was."""
    from tensionlab.plots import plot_run

    plot_run(_read(path), file)
    typer.echo(f"plot: {file}")


@log.command()
def replay(
    path: RunFile,
    solver: Annotated[
        list[str] | None,
        typer.Option(metavar="A,B,...", help="Solvers, such as newton,qp:daqp, also repeated; all if left out."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(callback=output.output_file(".parquet"), help="Write the rows to this Parquet file."),
    ] = None,
    json: Json = False,
) -> None:
    """Ask other solvers for the forces of a run, at its poses and with its modules, and score them like the run.

    The first row is the run as it was. The others say what each solver would have chosen, with its own policy for
    forces out of reach; where the hand or the platform would have gone then is not asked.
    """
    from tensionlab import records
    from tensionlab.comparison import replay as replays

    run = _read(path)
    names = output.words(solver)
    output.check_solvers(run.rig, names, None)
    with output.progress(f"Replaying {path.name}") as progress:
        found = replays.replay(run, names, progress)
    rows = [dataclasses.asdict(row) for row in found.rows]
    manifest = {**records.manifest(["tensionlab", *sys.argv[1:]]), "run": run.manifest}
    with output.Keeper(quiet=json) as keeper:
        if out:
            keeper.write("rows", out, lambda file: records.write_parquet(file, rows, manifest))
        if json:
            output.print_json(
                {
                    "rig": run.rig.name,
                    "cycles": found.cycles,
                    "rows": rows,
                    "left_out": found.missing,
                    "manifest": manifest,
                }
            )
            return
        title = f"{run.rig.name}, {run.rig.m} modules: {found.cycles} cycles of {path.name}"
        own = dataclasses.replace(found.rows[0], solver=f"the run: {found.rows[0].solver}")
        print_scores(title, [own, *found.rows[1:]], COLUMNS, found.missing, LEGEND, first_apart=True)


def _read(path: Path) -> Run:
    from tensionlab.hardware.log.reader import read_run

    with output.progress(f"Reading {path.name}") as progress:
        return read_run(path, progress)


def _print_info(found: RunReport) -> None:
    console = output.console()
    policy = f", nearest in {found.nearest}" if found.nearest else ""
    console.print(f"{found.rig}, {found.solver}{policy}", style="bold")
    console.print(
        f"{found.cycles} cycles in {found.duration:.2f} s, {found.rate:g} a second wanted, {found.missed} missed"
    )
    counts = ", ".join(f"{count} {name}" for name, count in found.statuses.items() if count) or "none"
    console.print(
        f"answers: {counts}; {found.replaced} replaced by newton's, {found.slewed} slowed by the slew limit"
    )
    for name, times, meaning in (
        ("late", found.late, "begin after the deadline"),
        ("work", found.work, "of the host"),
    ):
        written = ", ".join(output.duration(value) for value in times)
        console.print(f"{name}: {written} (median, 99 %, largest), {meaning}")
    if found.complete:
        console.print(f"ended: {found.ended or 'the log does not say why'}")
    else:
        console.print("cut off: the log was never closed, so its last moments may be missing", style="bold")
    console.print()
    console.print(_modules(found.modules))
    if found.events:
        console.print()
        for event in found.events[:EVENTS]:
            who = f" {event.module}:" if event.module else ""
            console.print(f"{event.time:9.3f} s  {event.kind}:{who} {event.text}", soft_wrap=True)
        if len(found.events) > EVENTS:
            console.print(f"and {len(found.events) - EVENTS} more events; --json has all", style="dim")


def _modules(modules: tuple[ModuleReport, ...]) -> Table:
    grid = output.table()
    grid.add_column("module")
    for heading in ("sent N\nleast", "\nmean", "\nmost", "telemetry age\nmedian", "\n99 %", "\nlargest"):
        grid.add_column(heading, justify="right", no_wrap=True)
    grid.add_column("held back by")
    for module in modules:
        held = [f"{name.lower()} {_share(share)}" for name, share in module.limits.items()]
        faults = [f"fault {name}" for name in module.faults]
        lost = [] if module.lost_at is None else [f"lost at {module.lost_at:.3f} s"]
        grid.add_row(
            module.name,
            *(output.short(value) for value in (module.sent_least, module.sent_mean, module.sent_most)),
            *(output.duration(value) for value in module.age),
            ", ".join([*held, *faults, *lost]),
        )
    return grid


def _share(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.005 else "<1 %"
