"""``tensionlab module calibrate``: what a module really is, from masses on its cable or from a force sensor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.calibrate_rig import anchors, lengths, record
from tensionlab.cli.common import calibrate_report, output
from tensionlab.cli.common.module_targets import Json

if TYPE_CHECKING:
    from tensionlab.hardware.calibration.gain import Balance
    from tensionlab.hardware.client.module import ModuleClient

calibrate = typer.Typer(
    help="Calibrate modules (N/A, friction, zero, lengths) and rigs (anchors).",
    no_args_is_help=True,
    rich_markup_mode=None,
)
Url = Annotated[str, typer.Argument(metavar="URL", help="Link to the module, or sim: for one with a mass on it.")]
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
    out: Annotated[Path, typer.Option(metavar="CSV", callback=output.output_file(".csv"), help="Write it there.")],
) -> None:
    """Pull at a force sensor in steps, up and down, and keep what the module measures.

    Tie the cable to the sensor, start the sensor's recording, run this, and stop the recording; then
    `gain URL --sensor FILE --staircase CSV`.
    """
    from tensionlab.hardware.calibration.staircase import climb
    from tensionlab.hardware.calibration.tables import table_text

    with _client(url) as client, output.progress("staircase") as progress:
        record = climb(client, progress)
    with output.Keeper() as keeper:
        keeper.write_text(
            f"{record.time[-1]:.0f} s, up to {record.tension.max():.2f} N", out, table_text(vars(record))
        )


def _client(url: str) -> ModuleClient:
    """Reach a module; behind ``sim:`` hangs a mass."""
    from tensionlab.hardware.calibration.hanging import HangingMass
    from tensionlab.hardware.client.module import ModuleClient
    from tensionlab.hardware.simulation.simulated_link import SimulatedLink
    from tensionlab.hardware.simulation.simulated_module import PLANT

    if url != "sim:":
        return ModuleClient(url, url)
    constant = SIMULATED_CONSTANT * PLANT["torque_constant"].standard
    typer.echo(
        f"Simulated: a module with {constant / PLANT['radius'].standard:.4g} N/A and a mass on its cable.",
        err=True,
    )
    return ModuleClient("sim", SimulatedLink(HangingMass(0.1, plant={"torque_constant": constant})))


def _weighed(client: ModuleClient, masses: list[float], repeat: int) -> list[Balance]:
    from tensionlab.hardware.calibration.hanging import HangingMass
    from tensionlab.hardware.calibration.weighing import weigh
    from tensionlab.hardware.simulation.simulated_link import SimulatedLink

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
    from tensionlab.hardware.protocol.codes import Calibration

    client.calibrate(Calibration.NEWTON_PER_AMPERE, value)
    client.save()


calibrate.command()(lengths)
calibrate.command()(record)
calibrate.command()(anchors)
