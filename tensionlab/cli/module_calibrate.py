"""``tensionlab module calibrate``: gain and friction of modules, lengths of cables, anchors of rigs."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.verbs import Json, Verbs, flag, option
from tensionlab.hardware.calibration import anchors as calibration
from tensionlab.hardware.calibration import lengths as length_calibration
from tensionlab.hardware.calibration.anchors import AnchorEstimate
from tensionlab.hardware.calibration.gain import Balance, GainEstimate, estimate_gain, weigh
from tensionlab.hardware.client.group import ModuleGroup, connect
from tensionlab.hardware.client.links import load_modules
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import Calibration
from tensionlab.hardware.protocol.messages import Save
from tensionlab.hardware.runner.settings import RealClock
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.simulated_module import PLANT, HangingMass
from tensionlab.model.files import load_rig, rig_to_toml
from tensionlab.model.rig import Rig
from tensionlab.support.files.tables import table_text
from tensionlab.support.formatting import format_vector
from tensionlab.support.table import Column, Table

calibrate = Verbs("Calibrate modules and rigs.")
Url = Annotated[
    str, typer.Argument(metavar="URL", help="Link to the module; sim: is one with a mass on its cable.")
]
ModulesOfRig = Annotated[Path, option("FILE", "Modules file (TOML): the link to each module.", "--modules")]
SIMULATED_CONSTANT = 1.1  # torque constant of `sim:` divided by the data sheet's: an error to find
LARGEST_UNCERTAINTY = 0.05  # share of a gain: a less certain one is not written to a module


@calibrate.command()
@output.if_interrupted(output.NOTHING_KEPT)
def gain(
    url: Url,
    mass: Annotated[list[float], option("KG", "Mass to hang on the cable; two or more are better.")],
    repeat: Annotated[int, option("N", "How often each mass is lifted.", min=2, max=100)] = 5,
    write: Annotated[bool, flag("--write", "Write the N/A to the module, and save it there.")] = False,
    json: Json = False,
) -> None:
    """Find N/A, friction and zero current of a module from masses on its cable.

    The module stands above, and the mass hangs still or stands on something, with 5 cm to rise. It is lifted and
    lowered slowly, some mm each time. Exit status 1 if the result is too uncertain to be written.
    """
    for kg in mass:
        if not 0.0 < kg < 100.0:
            raise typer.BadParameter(f"--mass {kg:g}: give kg, above 0 and below 100")
    with _open(url) as client:
        previous_gain = client.hello().newton_per_ampere
        estimate = estimate_gain([balance for kg in mass for balance in _weigh(client, kg, repeat)], previous_gain)
        uncertainty = estimate.gain.half_width / estimate.gain.value
        written = write and uncertainty <= LARGEST_UNCERTAINTY
        if written:
            client.calibrate(Calibration.NEWTON_PER_AMPERE, estimate.gain.value)
            client.command(Save())
    if json:
        output.print_json(
            url=url,
            newton_per_ampere_before=estimate.previous_gain,
            newton_per_ampere=estimate.gain,
            **output.fields(estimate, "friction", "zero", "balances"),
            error_before=estimate.before,
            error_after=estimate.after,
            written=written,
        )
    else:
        table = _gain_table(url, estimate)
        if written:
            table.notes.append(
                "Written and saved. A module may forget its cable's length then: calibrate that next."
            )
        output.print_table(table)
    if write and not written:
        certain = f"N/A is only certain to {100 * uncertainty:.1f} %"
        output.print_error(f"not written: {certain}; take masses that differ more, or more repeats")
        raise typer.Exit(1)


def _open(url: str) -> ModuleClient:
    """Open a module; on the cable of ``sim:`` hangs a mass."""
    if url != "sim:":
        return ModuleClient(url, url)
    constant = SIMULATED_CONSTANT * PLANT["torque_constant"].default
    gain = constant / PLANT["radius"].default
    output.print_message(f"Simulated: a module with {gain:.4g} N/A and a mass on its cable.")
    return ModuleClient("sim", SimulatedLink(HangingMass(0.1, plant={"torque_constant": constant})))


def _weigh(client: ModuleClient, mass: float, repeat: int) -> list[Balance]:
    if isinstance(client.link, SimulatedLink) and isinstance(client.link.module, HangingMass):
        client.link.module.mass = mass
    else:
        output.wait_for_enter(f"Hang {mass:g} kg on the cable, still, with 5 cm to rise")
    with output.progress(f"{mass:g} kg") as progress:
        return weigh(client, mass, repeat, progress)


def _gain_table(url: str, found: GainEstimate) -> Table:
    rows = [
        (name, old, round(estimate.value, digits), f"{estimate.lower:.{digits}f} to {estimate.upper:.{digits}f}")
        for name, old, estimate, digits in (
            ("tension for each ampere, N/A", found.previous_gain, found.gain, 4),
            ("friction and cogging, N", None, found.friction, 3),
            ("current at zero tension, A", None, found.zero, 4),
        )
        if estimate is not None
    ]
    rows.append(("error of tension (rms), N", round(found.before, 3), round(found.after, 3), ""))
    columns = ["", "before", "now", Column("interval", "95 %")]
    return Table(columns, rows, f"{len(found.balances)} balances at {url}")


@calibrate.command()
@output.if_interrupted(output.NOTHING_KEPT)
def lengths(path: options.RigArgument, modules: ModulesOfRig, json: Json = False) -> None:
    """Set the cable lengths of all modules of a rig.

    Hold the platform at the rig's home meanwhile. Modules forget them when they restart, and perhaps when they
    save.
    """
    rig = load_rig(path)
    output.print_message(
        f"Hold the platform at {format_vector(rig.home)} m, not turned: its cables are tightened."
    )
    with _group(rig, modules) as group:
        previous_lengths = length_calibration.zero_lengths(group, rig, RealClock(group.clients))
    after = rig.lengths(rig.home, frames=rig.at_rest)
    changes = list(zip((module.name for module in rig.modules), previous_lengths, after, strict=True))
    if json:
        changed = [{"name": name, "before": old, "length": new} for name, old, new in changes]
        output.print_json(rig=rig.name, modules=changed)
    else:
        columns = [
            "module",
            Column("before", "m", ".4f"),
            Column("now", "m", ".4f"),
            Column("change", "mm", "+.1f"),
        ]
        rows = [(name, old, new, 1e3 * (new - old)) for name, old, new in changes]
        output.print_table(Table(columns, rows, f"{rig.name} at home"))


@calibrate.command()
@output.if_interrupted(output.NOTHING_KEPT)
def record(
    path: options.RigArgument,
    modules: ModulesOfRig,
    out: Annotated[Path, options.writes("Write the lengths to this file.", ".csv", metavar="CSV")],
    poses: Annotated[int, option("N", "End after this number of poses.", min=1)] = 30,
    seconds: Annotated[float, option("S", "End after this time at the latest, in s.", min=1.0)] = 300.0,
) -> None:
    """Record cable lengths at poses, for `anchors`.

    Move the platform, and hold it still for half a second at each pose. Spread the poses over the whole
    workspace. Columns x, y and z may be added to the file.
    """
    rig = load_rig(path)
    with _group(rig, modules) as group:
        measured = length_calibration.record_lengths(
            group,
            rig,
            RealClock(group.clients),
            poses,
            seconds,
            lambda count: output.print_message(f"pose {count}"),
        )
    with output.ResultWriter() as writer:
        writer.write_text(f"{len(measured)} poses", out, table_text(length_calibration.columns(rig, measured)))


@calibrate.command()
def anchors(
    path: options.RigArgument,
    measured: Annotated[Path, typer.Argument(metavar="LENGTHS", help="CSV: a column of lengths for each module.")],
    known: Annotated[bool, flag("--known", "The file's x, y, z (and rotation) are the platform's poses.")] = False,
    offsets: Annotated[bool, flag("--offsets", "Also find a constant error of each cable's length.")] = False,
    out: Annotated[Path | None, options.writes("Write the calibrated rig here.", ".toml", metavar="RIG")] = None,
    json: Json = False,
) -> None:
    """Find the anchors of a rig from cable lengths.

    At known or unknown poses. Lengths come from `record`, or from a tape measure. At unknown poses the rig needs
    more cables than degrees of freedom, and its place and rotation are kept as in the rig file: lengths cannot
    show them. Nor do they show an error that is the same share of all lengths. Lengths that modules count from a
    zero set at the file's anchors have constant errors: find them with --offsets. For a platform, give rough poses
    all the same: the search starts from them.
    """
    rig = load_rig(path)
    values, poses = length_calibration.load_lengths(measured, rig)
    if known and poses is None:
        raise typer.BadParameter(f"--known: {measured} has no columns x, y (and z) of the poses")
    estimate = calibration.calibrate_anchors(rig, values, poses, known=known, offsets=offsets)
    errors = calibration.length_errors(rig, values, estimate, known=known, offsets=offsets)
    how = f"{len(values)} {'known' if known else 'unknown'} poses"
    with output.ResultWriter(quiet=json) as writer:
        if out is not None:
            source = f"anchors calibrated from {how} ({measured.name})"
            if not writer.write_text("rig", out, rig_to_toml(calibration.calibrated_rig(rig, estimate, source))):
                out = None
        if json:
            columns = {"nominal": rig.anchors, "anchor": estimate.anchors, "deviation": estimate.deviations,
                       "interval": estimate.intervals, "length_offset": estimate.offsets}  # fmt: skip
            rows = [
                {"name": module.name} | {name: column[j] for name, column in columns.items()}
                for j, module in enumerate(rig.modules)
            ]
            output.print_json(rig=rig.name, poses=len(values), known=known, freedom=estimate.freedom,
                              length_deviation=estimate.sigma, misfit=errors, modules=rows,
                              written=out)  # fmt: skip
        else:
            table = _anchors_table(rig, estimate, f"{rig.name}: anchors from {how} (± 95 %)")
            prior, after, held = ("–" if math.isnan(rms) else f"{1e3 * rms:.2f} mm" for rms in errors.values())
            kind = "rms" if known else "rms, beyond what the poses take up"
            table.notes = [
                f"Error of the lengths: {prior} before, {after} now, {held} at poses that were held out ({kind})."
            ]
            if not known:
                table.notes.append(
                    "The rig's place and rotation are kept as in the file: lengths cannot show them."
                )
            output.print_table(table)


def _anchors_table(rig: Rig, found: AnchorEstimate, title: str) -> Table:
    moved = np.linalg.norm(found.anchors - rig.anchors, axis=1)
    rows = []
    for j, module in enumerate(rig.modules):
        places = [
            f"{x:.4f} ± {'–' if math.isnan(width) else f'{width:.4f}'}"
            for x, width in zip(found.anchors[j], found.intervals[j], strict=True)
        ]
        rows.append(
            (module.name, *places, 1e3 * moved[j], 1e3 * found.offsets[j] if found.offsets.any() else None)
        )
    axes = [Column(axis, "m") for axis in "xyz"[: rig.dimension]]
    columns = ["module", *axes, Column("moved", "mm", ".1f"), Column("length error", "mm", ".1f")]
    return Table(columns, rows, title)


def _group(rig: Rig, modules: Path) -> closing[ModuleGroup]:
    return closing(connect(rig, load_modules(modules)))
