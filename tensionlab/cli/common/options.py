"""Arguments and options that several verbs share, and how their values are read and checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from tensionlab.cli.common.verbs import EXAMPLES, flag, option, port_option
from tensionlab.errors import WriteError
from tensionlab.model.files import load_requirement, load_rig
from tensionlab.model.module import KINDS
from tensionlab.model.pose import RestPose
from tensionlab.model.rig import Rig
from tensionlab.solvers import every_solver, select_solvers
from tensionlab.support.arrays import MAX_MAGNITUDE, Floats
from tensionlab.support.files import writing
from tensionlab.support.files.named import list_names
from tensionlab.support.files.reading import brief
from tensionlab.support.formatting import format_count
from tensionlab.support.provenance import TABLE_SUFFIXES
from tensionlab.workspace.orientations import Orientations, parse_rotations

STEPS = 40  # number of steps along the longest edge of a box, if no step is given


def parse_numbers(name: str, text: str) -> list[float]:
    """Return the numbers in an option, separated by commas or spaces; there must be one at least."""
    example = f"write {name} {EXAMPLES.get(name, '0 -0.1 0.3')}"
    values: list[float] = []
    for part in text.replace(",", " ").split():
        try:
            values.append(float(part))
        except ValueError:
            raise typer.BadParameter(f"{name}: {brief(part)} is not a number; {example}") from None
    if not values:
        raise typer.BadParameter(f"{name}: no numbers; {example}")
    if not all(abs(value) < MAX_MAGNITUDE for value in values):
        raise typer.BadParameter(f"{name} is {text.replace(',', ' ')}; give finite numbers below 1e100")
    return values


def parse_components(name: str, text: str, components: list[str], owner: str) -> list[float]:
    """Return the numbers in an option, one for each component of its owner."""
    values = parse_numbers(name, text)
    if len(values) != len(components):
        given = format_count(len(values), "component")
        raise typer.BadParameter(f"{name} has {given}; {owner} needs {len(components)}: {', '.join(components)}")
    return values


def parse_position(text: str | None, rig: Rig) -> Floats:
    """Return the position that ``--at`` gives, in m; the rig's home if it is left out."""
    axes = [f"{axis} (m)" for axis in "xyz"[: rig.dimension]]
    return rig.home if text is None else np.array(parse_components("--at", text, axes, rig.name))


def parse_rotation(text: str | None, rig: Rig) -> Floats | None:
    """Return the orientation that ``--rotation`` gives, as `Rig.structure_matrix` takes it; None if left out."""
    if text is None:
        return None
    if not KINDS[rig.kind].has_orientation:
        raise typer.BadParameter(f"--rotation: {rig.name} is a {rig.kind} rig and cannot turn; leave it out")
    axes = [f"r{axis} (rad)" for axis in ("xyz" if rig.dimension == 3 else "z")]
    turn = np.array(parse_components("--rotation", text, axes, rig.name))
    return replace(rig, home_rotation=turn).home_orientation


def parse_names(values: list[str] | None) -> list[str] | None:
    """Return the names in an option that is repeated, or has commas; None if left out."""
    if values is None:
        return None
    return [name.strip() for value in values for name in value.split(",") if name.strip()]


def require_positive(value: float | None) -> float | None:
    """Refuse a number that is not finite and above 0, as the callback of an option."""
    if value is not None and not 0.0 < value < math.inf:
        raise typer.BadParameter(f"give a finite number above 0; got {value:g}")
    return value


def load(
    name: str,
    frames: list[str] | None = None,
    wrench: str | None = None,
    gravity: bool | None = None,
    required: Path | None = None,
    acceleration: str | None = None,
) -> Rig:
    """Load a rig, and place its body frames and have it require what the options say."""
    rig = load_rig(name)
    rest = {pose.name: pose for pose in rig.rest}
    for text in frames or []:
        body, _, numbers = text.partition(",")
        values, d = parse_numbers(f"--frame {body}", numbers), rig.dimension
        turn = 3 if d == 3 else 1
        if len(values) not in (d, d + turn):
            given = f"--frame {body} has {format_count(len(values), 'number')}"
            wanted = f"{d} for the position in m, and {turn} more for a rotation in rad, if it is turned"
            raise typer.BadParameter(f"{given}; {rig.name} needs {wanted}")
        rest[body] = RestPose(body, np.array(values[:d]), np.array(values[d:]) if values[d:] else None)
    return with_requirement(replace(rig, rest=tuple(rest.values())), wrench, gravity, required, acceleration)


def with_requirement(
    rig: Rig,
    wrench: str | None,
    gravity: bool | None,
    required: Path | None = None,
    acceleration: str | None = None,
) -> Rig:
    """Return the rig with what the options require of it; refuse what does not suit it."""
    requirement = rig.required if required is None else load_requirement(required)
    if wrench is not None:
        numbers = parse_components("--wrench", wrench, wrench_components(rig), rig.name)
        requirement = replace(requirement, wrench=np.array(numbers))
    if acceleration is not None:
        given = parse_numbers("--acceleration", acceleration)
        requirement = replace(requirement, acceleration=np.array(given if len(given) > 1 else given[0]))
    return replace(rig, required=requirement if gravity is None else replace(requirement, gravity=gravity))


def wrench_components(rig: Rig) -> list[str]:
    """Return names and units of the components of a rig's wrench."""
    axes, kind = "xyz"[: rig.dimension], KINDS[rig.kind]
    torques = axes[-kind.turns :] if rig.dimension == 3 and kind.turns else "z" * kind.turns
    return [f"F{axis} (N)" for axis in axes if kind.has_position] + [f"M{axis} (N·m)" for axis in torques]


def parse_region(rigs: list[Rig], box: str | None, step: str | None) -> tuple[Floats, Floats]:
    """Return where the box starts and ends along each axis, (d, 2), and its step: one, or one for each axis."""
    dimension = rigs[0].dimension
    if box is None and not KINDS[rigs[0].kind].has_position:
        ends = np.stack([rigs[0].home, rigs[0].home], axis=-1)
    elif box is None:
        points = np.concatenate([[rig.home, *rig.anchors] for rig in rigs if rig.dimension == dimension])
        ends = np.stack([points.min(axis=0), points.max(axis=0)], axis=-1)
    else:
        numbers = parse_numbers("--box", box)
        if len(numbers) != 2 * dimension:
            names = " ".join(f"{axis}0 {axis}1" for axis in "xyz"[:dimension])
            mismatch = f"--box has {format_count(len(numbers), 'number')}"
            raise typer.BadParameter(f"{mismatch}; {rigs[0].name} needs {2 * dimension}: {names}")
        ends = np.array(numbers).reshape(dimension, 2)
    if step is None:
        return ends, np.array(float(np.ptp(ends, axis=1).max()) / STEPS or 1.0)
    steps = np.array(parse_numbers("--step", step))
    if not (steps > 0).all() or len(steps) not in (1, dimension):
        given = step.replace(",", " ")
        raise typer.BadParameter(f"--step is {given}; give one length in m, or {dimension}, above zero")
    return ends, steps[0] if len(steps) == 1 else steps


def parse_orientations(rig: Rig, rotations: str | None) -> Orientations | Floats | None:
    """Return the orientations at every position, if there are any."""
    up = rig.upward if rig.up else np.eye(rig.dimension)[-1]
    return None if rotations is None else parse_rotations(rotations, rig.dimension, up)


def check_solvers(rig: Rig, names: list[str] | None, policy: str | None) -> None:
    """Refuse solvers that do not support the rig with that policy, before the work."""
    select_solvers(names, policy, (rig.n, rig.m))


def checked(check: Callable[[Path], None]) -> Callable[[Path | None], Path | None]:
    """Return a check as the callback of an option that may be left out; the parser's message names the option."""

    def callback(path: Path | None) -> Path | None:
        try:
            if path is not None:
                check(path)
        except WriteError as error:
            raise typer.BadParameter(str(error)) from None
        return path

    return callback


def writes(help_text: str, *suffixes: str, metavar: str = "FILE", names: Sequence[str] = ("--out", "-o")) -> Any:
    """Return an option that names a file to write, with one of the suffixes, if there are any."""
    return option(
        metavar, help_text, *names, callback=checked(lambda path: writing.require_writable(path, suffixes))
    )


def writes_folder(help_text: str, suffix: str = "", *, parents: bool = False) -> Any:
    """Return an option that names a folder to write, or as text a URL."""

    def check(place: str | Path) -> None:
        if Path(place).suffix.lower() != suffix and suffix:
            raise WriteError(f"{place}: the name must end in {suffix}")
        if "://" not in str(place):
            writing.require_folder(Path(place), parents=parents)

    return option(f"DIR{suffix}", help_text, "--out", "-o", callback=checked(check))


@checked
def picture_file(path: Path) -> None:
    """Check that a picture can be written there."""
    from tensionlab.plots import METADATA

    writing.require_writable(path, tuple(METADATA))


@checked
def log_file(path: Path) -> None:
    """Check that a new log can be written there."""
    writing.require_writable(path, (".mcap",))
    writing.require_new(path, "the log")


def require_lsl_if(wanted: bool) -> bool:
    """Check that streams for Lab Streaming Layer can be opened, if they are wanted."""
    if wanted:
        from tensionlab.interop.lsl import require_lsl

        require_lsl()
    return wanted


def complete(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return a shell completion by names; the shell itself completes paths."""
    return lambda incomplete: [name for name in names() if name.startswith(incomplete)]


def stored_argument(kind: str, metavar: str, note: str = "") -> Any:
    """Return an argument that is the name of a data set of a kind, or a file; the note ends its help."""
    what = kind.removesuffix("s")
    return typer.Argument(
        metavar=metavar,
        help=f"Name of a {what}, as `tensionlab datasets {kind}` lists them, or file (TOML){note}.",
        autocompletion=complete(lambda: list_names(kind)),
    )


def rig_argument(note: str = "") -> Any:
    """Return an argument that is a rig."""
    return stored_argument("rigs", "RIG", note)


RigArgument = Annotated[str, rig_argument()]
RunFile = Annotated[Path, typer.Argument(metavar="RUN", help="Log of a run (*.mcap).")]
Seed = Annotated[int, option("N", "Seed of all random numbers.", min=0)]
At = Annotated[str | None, option("X Y Z", "Position in m; the rig's home if left out.")]
Rotation = Annotated[
    str | None,
    option("RX RY RZ", "Orientation, axis times angle in rad; in the plane one angle. Left out: as at home."),
]
BodyFrames = Annotated[
    list[str] | None,
    option(
        "NAME X Y Z [RX RY RZ]",
        "Pose of a body frame, in m and rad; may be repeated. Left out: at rest.",
        "--frame",
    ),
]
Solver = Annotated[
    str,
    option("NAME", "Name of a solver, as `tensionlab solvers` lists them.", autocompletion=complete(every_solver)),
]
Solvers = Annotated[list[str] | None, option("A,B,...", "Solvers, such as newton,qp:daqp; all if left out.")]
Policy = Annotated[
    str | None,
    option(
        "POLICY",
        "If the wrench is infeasible, render the nearest in: force, tension, direction. Left out: the solver's.",
    ),
]
Plot = Annotated[Path | None, option("FILE", "Draw to this file (png, pdf, svg).", callback=picture_file)]
Rows = Annotated[Path | None, writes("Write the rows to this file: Parquet or CSV.", *TABLE_SUFFIXES)]
Log = Annotated[
    Path | None,
    option("FILE.mcap", "Log every cycle to this file, a new one; see `tensionlab log`.", callback=log_file),
]
Lsl = Annotated[
    bool,
    flag("--lsl", "Stream forces, tensions, pose and markers by Lab Streaming Layer.", callback=require_lsl_if),
]
PagePort = Annotated[int, port_option("Port of the page; 0 takes a free one.", "--port")]
Browser = Annotated[bool, flag("--browser/--no-browser", "Whether to open a browser.")]
View = Annotated[bool, flag("--view", "Show the run in the browser, with a button that stops its modules.")]
Duration = Annotated[
    float | None,
    option("S", "Duration in s; to the end, or until Ctrl-C, if left out.", callback=require_positive),
]
Modules = Annotated[
    str | None,
    option("FILE|URL,...", "Modules file, or a link for each module in order. Left out: simulated modules."),
]
Box = Annotated[
    str | None,
    option("X0 X1 Y0 Y1 Z0 Z1", "Box of positions in m; Z0 = Z1 is a plane. Left out: around anchors and homes."),
]
Step = Annotated[
    str | None,
    option(
        "STEP",
        f"Step or cell edge in m: one, or one for each axis. Left out: {STEPS} steps along the longest edge.",
    ),
]
Rotations = Annotated[
    str | None,
    option(
        "SET",
        "Orientations at every position of the box, in degrees: cone:10, tilt of the axis that points up; "
        "rpy:-10..10,0,-30..30, roll, pitch and yaw about x, y and z; in the plane angle:-30..30; each with "
        ":STEP, 5 if left out. Or a file (.csv): rx, ry, rz, axis times angle, rad.",
    ),
]
Scheduler = Annotated[str | None, option("URL", "Evaluate on a Dask cluster, tcp://HOST:PORT.")]
Wrench = Annotated[
    str | None,
    option("FX FY ...", "Wrench that the cables must exert, in N (and N·m); the middle of a set of them."),
]
Gravity = Annotated[
    bool | None,
    flag("--gravity/--no-gravity", "Whether cables hold the platform's weight, too. Left out: as the file says."),
]
Acceleration = Annotated[
    str | None,
    option(
        "AX AY ...",
        "Accelerations that cables also give, along each axis or in all directions, in m/s² (and rad/s²).",
    ),
]
Required = Annotated[
    Path | None,
    option("FILE", "File of required wrenches (TOML): a box, a ball or a list. Left out: as the rig's file says."),
]
