"""``tensionlab module calibrate``: what modules and rigs really are, from what is measured on them."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli import calibrate_report, output

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tensionlab.hardware.calibration.gain import Balance
    from tensionlab.hardware.group import ModuleGroup
    from tensionlab.hardware.module import ModuleClient
    from tensionlab.model.rig import Rig

calibrate = typer.Typer(
    help="Calibrate modules (N/A, friction, zero, lengths) and rigs (anchors).",
    no_args_is_help=True,
    rich_markup_mode=None,
)
Url = Annotated[str, typer.Argument(metavar="URL", help="Link to the module, or sim: for one with a mass on it.")]
RigFile = Annotated[Path, typer.Argument(metavar="RIG", help="Rig file (TOML).", show_default=False)]
Modules = Annotated[
    Path, typer.Option("--modules", metavar="FILE", help="Modules file (TOML): the link to each module.")
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")]
SIMULATED_CONSTANT = 1.1
"""By how much the torque constant of ``sim:`` is off the data sheet's, so that there is something to find."""
SURE = 0.05
"""An N/A that is not sure to this share is not written to a module."""


@calibrate.command()
def gain(
    url: Url,
    mass: Annotated[
        list[float] | None, typer.Option(metavar="KG", help="Mass to hang on the cable; two or more are better.")
    ] = None,
    repeat: Annotated[int, typer.Option(help="How often each mass is lifted.", min=2, max=100)] = 5,
    sensor: Annotated[
        Path | None, typer.Option(metavar="CSV", help="What a force sensor showed: columns time (s), force (N).")
    ] = None,
    staircase: Annotated[
        Path | None, typer.Option(metavar="CSV", help="What the module did meanwhile: from `staircase`.")
    ] = None,
    lag: Annotated[
        float | None, typer.Option(metavar="S", help="By how much the sensor's clock is ahead; found if left out.")
    ] = None,
    write: Annotated[
        bool, typer.Option("--write", help="Write the N/A to the module, and have it saved.")
    ] = False,
    json: Json = False,
) -> None:
    """Find N/A, friction and zero current of a module, from masses on its cable or from a force sensor.

    The module stands above, and the mass hangs still or stands on something, with 5 cm to rise. It is lifted and
    let down slowly, some mm each time. Exit status 1 if the answer is too vague to be written.
    """
    from tensionlab.hardware.calibration.gain import gain_from_sensor, gain_from_weights

    if (mass is None) == (sensor is None):
        raise typer.BadParameter("give either --mass, once or repeatedly, or --sensor with --staircase")
    if (sensor is None) != (staircase is None):
        raise typer.BadParameter("--sensor and --staircase belong together; `staircase` records the latter")
    for each in mass or []:
        if not 0.0 < each < 100.0:
            raise typer.BadParameter(f"--mass {each:g}: give kg, above 0")
    read = _sensor_balances(sensor, staircase, lag) if sensor and staircase else []
    with _client(url) as client:
        believed = client.hello().newton_per_ampere
        if mass:
            found = gain_from_weights(_weighed(client, mass, repeat), believed)
        else:
            found = gain_from_sensor(read, believed)
        sure = found.gain.half_width <= SURE * found.gain.value
        if write and sure:
            _write_gain(client, found.gain.value)
    if json:
        output.print_json(calibrate_report.gain_json(url, found, written=write and sure))
    else:
        calibrate_report.show_gain(url, found)
        if write and sure:
            typer.echo(
                "\nWritten and saved. Saving may make a module forget its cable's length: calibrate that next."
            )
    if write and not sure:
        typer.echo(
            f"not written: N/A is only sure to {100 * found.gain.half_width / found.gain.value:.1f} %; take "
            "masses that differ more, or more repeats",
            err=True,
        )
        raise typer.Exit(1)


@calibrate.command()
def staircase(
    url: Url,
    out: Annotated[Path, typer.Option(metavar="CSV", callback=output.output_file, help="Write it there.")],
) -> None:
    """Pull at a force sensor in steps, up and down, and keep what the module measures.

    Tie the cable to the sensor, start the sensor's recording, run this, and stop the recording; then
    `gain URL --sensor FILE --staircase CSV`.
    """
    from tensionlab.hardware.calibration.staircase import climb

    with _client(url) as client, output.progress("staircase") as progress:
        record = climb(client, progress)
    record.save(out)
    typer.echo(f"{record.time[-1]:.0f} s, up to {record.tension.max():.2f} N: {out}")


@calibrate.command()
def lengths(path: RigFile, modules: Modules, json: Json = False) -> None:
    """Tell all modules of a rig how long their cables are: hold the platform at the rig's home meanwhile.

    Modules forget it when they restart, and perhaps when they save.
    """
    from tensionlab.hardware.calibration.lengths import zero_lengths
    from tensionlab.hardware.run.clock import RealClock
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


@calibrate.command()
def record(
    path: RigFile,
    modules: Modules,
    out: Annotated[Path, typer.Option(metavar="CSV", callback=output.output_file, help="Write lengths there.")],
    poses: Annotated[int, typer.Option(help="End after so many poses.", min=1)] = 30,
    seconds: Annotated[float, typer.Option(help="End after that time at the latest.", min=1.0)] = 300.0,
) -> None:
    """Record cable lengths while a person moves the platform: hold it still for half a second at each pose.

    Spread the poses over the whole workspace. The result is for `anchors`; columns x, y and z may be added to it.
    """
    from tensionlab.hardware.calibration.lengths import columns, record_lengths
    from tensionlab.hardware.calibration.tables import write_table
    from tensionlab.hardware.run.clock import RealClock
    from tensionlab.model.files import load_rig

    rig = load_rig(path)
    with _group(rig, modules) as group:
        measured = record_lengths(
            group, rig, RealClock(), poses, seconds, lambda count: typer.echo(f"pose {count}", err=True)
        )
    write_table(out, columns(rig, measured))
    typer.echo(f"{len(measured)} poses: {out}")


@calibrate.command()
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
        Path | None, typer.Option(metavar="RIG", callback=output.output_file, help="Write the rig so found there.")
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
    from tensionlab.model.files import load_rig, save_rig

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
    if out is not None:
        how = f"anchors calibrated from {len(values)} {'known' if known else 'unknown'} poses ({measured.name})"
        save_rig(calibrated_rig(rig, found, how), out)
    if json:
        output.print_json(calibrate_report.anchors_json(rig, found, misfits, out, known=known, offsets=offsets))
    else:
        calibrate_report.show_anchors(rig, found, misfits, known=known, offsets=offsets)
        if out is not None:
            typer.echo(f"\nrig: {out}")


def _client(url: str) -> ModuleClient:
    """Reach a module; behind ``sim:`` hangs a mass."""
    from tensionlab.hardware.calibration.hanging import HangingMass
    from tensionlab.hardware.link import SimulatedLink
    from tensionlab.hardware.module import ModuleClient
    from tensionlab.hardware.simulated import PLANT

    if url != "sim:":
        return ModuleClient(url, url)
    constant = SIMULATED_CONSTANT * PLANT["torque_constant"].standard
    typer.echo(
        f"Simulated: a module with {constant / PLANT['radius'].standard:.4g} N/A and a mass on its cable.",
        err=True,
    )
    return ModuleClient("sim", SimulatedLink(HangingMass(0.1, plant={"torque_constant": constant})))


@contextlib.contextmanager
def _group(rig: Rig, modules: Path) -> Iterator[ModuleGroup]:
    """Reach all modules of a rig, and let go of them."""
    from tensionlab.hardware.group import connect
    from tensionlab.hardware.modules_file import load_modules

    group = connect(rig, load_modules(modules))
    try:
        yield group
    finally:
        group.close()


def _weighed(client: ModuleClient, masses: list[float], repeat: int) -> list[Balance]:
    from tensionlab.hardware.calibration.hanging import HangingMass
    from tensionlab.hardware.calibration.weighing import weigh
    from tensionlab.hardware.link import SimulatedLink

    balances = []
    for mass in masses:
        if isinstance(client.link, SimulatedLink) and isinstance(client.link.module, HangingMass):
            client.link.module.mass = mass
        else:
            typer.prompt(
                f"Hang {mass:g} kg on the cable, still, with 5 cm to rise; then press Enter",
                default="",
                show_default=False,
                prompt_suffix=" ",
                err=True,
            )
        with output.progress(f"{mass:g} kg") as progress:
            balances += weigh(client, mass, repeat, progress)
    return balances


def _sensor_balances(sensor: Path, staircase: Path, ahead: float | None) -> list[Balance]:
    from tensionlab.hardware.calibration.staircase import balances, lag, load_sensor, load_staircase

    taken = load_staircase(staircase)
    time, force = load_sensor(sensor)
    return balances(taken, time, force, lag(taken, time, force) if ahead is None else ahead)


def _write_gain(client: ModuleClient, value: float) -> None:
    from tensionlab.hardware.codes import Calibration

    client.calibrate(Calibration.NEWTON_PER_AMPERE, value)
    client.save()
