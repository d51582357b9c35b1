"""``tensionlab module calibrate``: where a rig's anchors are, and how long its cables."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import calibrate_report, output
from tensionlab.cli.common.module_targets import Json

if TYPE_CHECKING:
    from tensionlab.hardware.client.group import ModuleGroup
    from tensionlab.model.rig import Rig

RigFile = Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML).", show_default=False)]
Modules = Annotated[
    Path, typer.Option("--modules", metavar="FILE", help="Modules file (TOML): the link to each module.")
]


def lengths(path: RigFile, modules: Modules, json: Json = False) -> None:
    """Tell all modules of a rig how long their cables are: hold the platform at the rig's home meanwhile.

    Modules forget it when they restart, and perhaps when they save.
    """
    from tensionlab.hardware.calibration.lengths import zero_lengths
    from tensionlab.hardware.runner.settings import RealClock
    from tensionlab.model.files import load_rig

    rig = load_rig(path)
    typer.echo(
        f"Hold the platform at {output.vector(rig.home)} m, not turned. Its cables are pulled tight.", err=True
    )
    with _group(rig, modules) as group:
        before = zero_lengths(group, rig, RealClock())
    after = rig.lengths(rig.home, frames=rig.at_rest)
    if json:
        output.print_json(
            {
                "rig": rig.name,
                "modules": [
                    {"name": module.name, "before": old, "length": new}
                    for module, old, new in zip(rig.modules, before, after, strict=True)
                ],
            }
        )
        return
    grid = output.table(f"{rig.name} at home")
    for heading in ("module", "before\nm", "now\nm", "change\nmm"):
        grid.add_column(heading, justify="left" if heading == "module" else "right", no_wrap=True)
    for module, old, new in zip(rig.modules, before, after, strict=True):
        known = not math.isnan(old)
        change = f"{1e3 * (new - old):+.1f}" if known else "–"
        grid.add_row(module.name, f"{old:.4f}" if known else "–", f"{new:.4f}", change)
    output.console().print(grid)


def record(
    path: RigFile,
    modules: Modules,
    out: Annotated[
        Path, typer.Option(metavar="CSV", callback=output.output_file(".csv"), help="Write lengths there.")
    ],
    poses: Annotated[int, typer.Option(help="End after so many poses.", min=1)] = 30,
    seconds: Annotated[float, typer.Option(help="End after that time at the latest.", min=1.0)] = 300.0,
) -> None:
    """Record cable lengths while a person moves the platform: hold it still for half a second at each pose.

    Spread the poses over the whole workspace. The result is for `anchors`; columns x, y and z may be added to it.
    """
    from tensionlab.hardware.calibration.lengths import columns, record_lengths
    from tensionlab.hardware.calibration.tables import table_text
    from tensionlab.hardware.runner.settings import RealClock
    from tensionlab.model.files import load_rig

    rig = load_rig(path)
    with _group(rig, modules) as group:
        measured = record_lengths(
            group, rig, RealClock(), poses, seconds, lambda count: typer.echo(f"pose {count}", err=True)
        )
    with output.Keeper() as keeper:
        keeper.write_text(f"{len(measured)} poses", out, table_text(columns(rig, measured)))


def anchors(
    path: RigFile,
    measured: Annotated[
        Path,
        typer.Argument(metavar="LENGTHS", help="CSV: a column of lengths for each module.", show_default=False),
    ],
    known: Annotated[
        bool, typer.Option("--known", help="The file's x, y, z (and rotation) are where the platform was.")
    ] = False,
    offsets: Annotated[
        bool, typer.Option("--offsets", help="Each cable's length may be off by a constant; find it as well.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="RIG", callback=output.output_file(".toml"), help="Write the rig so found there."),
    ] = None,
    json: Json = False,
) -> None:
    """Find the anchors of a rig from cable lengths, at known or unknown poses.

    Lengths come from `record`, or from a tape measure. At unknown poses the rig needs more cables than freedoms,
    and where it stands and how it is turned is kept as in the rig file: lengths cannot tell. Nor do they tell if
    all are off by the same share. For a platform, give rough poses all the same: the search starts from them.
    """
    from tensionlab.hardware.calibration.anchors import calibrate_anchors, calibrated_rig
    from tensionlab.hardware.calibration.held_out import held_out_misfit, nominal_misfit
    from tensionlab.hardware.calibration.lengths import load_lengths
    from tensionlab.model.files import load_rig, rig_to_toml

    rig = load_rig(path)
    values, poses = load_lengths(measured, rig)
    if known and poses is None:
        raise typer.BadParameter(f"--known: {measured} has no columns x, y (and z) of the poses")
    found = calibrate_anchors(rig, values, poses, known=known, offsets=offsets)
    misfits = {
        "before": nominal_misfit(rig, values, found.poses, known=known),
        "after": found.sigma,
        "held_out": held_out_misfit(rig, values, found.poses, known=known, offsets=offsets),
    }
    how = f"anchors calibrated from {len(values)} {'known' if known else 'unknown'} poses ({measured.name})"
    with output.Keeper(quiet=json) as keeper:
        kept = out if out and keeper.write_text("rig", out, rig_to_toml(calibrated_rig(rig, found, how))) else None
        if json:
            output.print_json(
                calibrate_report.anchors_json(rig, found, misfits, kept, known=known, offsets=offsets)
            )
        else:
            calibrate_report.show_anchors(rig, found, misfits, known=known, offsets=offsets)


@contextmanager
def _group(rig: Rig, modules: Path) -> Iterator[ModuleGroup]:
    """Reach all modules of a rig, and let go of them."""
    from tensionlab.hardware.client.group import connect
    from tensionlab.hardware.client.modules_file import load_modules

    group = connect(rig, load_modules(modules))
    try:
        yield group
    finally:
        group.close()
