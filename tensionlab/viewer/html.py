"""HTML of the pages, by the macros of the Jinja templates in `templates`."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import optional_import
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit, State
from tensionlab.solvers.base import Status
from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREEN, GREY, ORANGE, RED
from tensionlab.support.formatting import format_count, format_duration, format_number
from tensionlab.support.table import STATUS_MARKS

if TYPE_CHECKING:
    import jinja2

ZERO = 1e-9  # largest rounding error of a number that is shown as 0


def render(macro: str, *values: Any) -> str:
    """Return the HTML of a macro, such as "run.forces" of run.html, with values; all text in them is escaped."""
    page, name = macro.split(".")
    return str(getattr(_environment().get_template(f"{page}.html").module, name)(*values))


@cache
def _environment() -> jinja2.Environment:
    with optional_import("view", "the view"):
        import jinja2
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        auto_reload=False,
    )
    environment.globals.update(BLUE=BLUE, GREEN=GREEN, GREY=GREY, ORANGE=ORANGE, RED=RED)
    environment.globals.update(
        FORCE_COLOURS=FORCE_COLOURS, STATUS_MARKS=STATUS_MARKS, isfinite=np.isfinite, isnan=np.isnan
    )
    environment.globals.update({code.__name__: code for code in (BrakeState, Fault, Limit, State, Status)})
    environment.filters.update(
        count=format_count,
        duration=format_duration,
        norm=np.linalg.norm,
        number=_number,
        short=format_number,
        tension=tension_text,
    )
    return environment


def tension_text(tension: float) -> str:
    """Return a tension in N as text."""
    return "unknown" if math.isnan(tension) else f"{format_number(tension)} N"


def _number(value: float) -> str:
    """Return a number in three digits; a rounding error as 0."""
    return "0" if abs(value) < ZERO else f"{value:.3g}"
