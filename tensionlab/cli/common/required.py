"""Options that say what the cables must exert: ``--wrench``, ``--gravity`` and ``--required``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from tensionlab.cli.common import options, output
from tensionlab.model.files import load_requirement
from tensionlab.model.rig import Rig

Wrench = Annotated[
    str | None,
    typer.Option(
        metavar="FX FY ...",
        help="Wrench that the cables must exert, in N (and N·m); the middle of a set of them.",
        show_default=False,
    ),
]
Gravity = Annotated[
    bool | None,
    typer.Option(
        "--gravity/--no-gravity",
        help="Whether the cables hold the platform's weight as well. Left out: as the file says.",
        show_default=False,
    ),
]
Required = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="File of required wrenches (TOML): a box, a ball or a list. Left out: what the file itself says.",
        show_default=False,
    ),
]


def with_requirement(rig: Rig, wrench: str | None, gravity: bool | None, required: Path | None = None) -> Rig:
    """Return the rig with what the options require of it; refuse what does not suit it."""
    found = rig.required if required is None else load_requirement(required)
    if wrench is not None:
        numbers = options.parse_numbers("--wrench", wrench)
        options.check_components("--wrench", numbers, output.components(rig), rig.name)
        found = replace(found, wrench=np.array(numbers))
    return replace(rig, required=found if gravity is None else replace(found, gravity=gravity))
