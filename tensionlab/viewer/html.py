"""HTML of the pages: macros of the Jinja templates in `templates`, and the numbers in them."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tensionlab.errors import optional_import
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, Colours
from tensionlab.support.formatting import format_count, format_duration, format_number

if TYPE_CHECKING:
    import jinja2

COLOURS = {
    "BLUE": BLUE, "ORANGE": ORANGE, "GREEN": GREEN, "RED": RED, "PURPLE": PURPLE, "GREY": GREY,
}  # fmt: skip
ZERO = 1e-9  # largest rounding error of a number that is shown as 0


def render(macro: str, *values: Any) -> str:
    """Return the HTML of a macro, such as "run.forces" of run.html, with values; all text in them is escaped."""
    page, name = macro.split(".")
    return str(getattr(_environment().get_template(f"{page}.html").module, name)(*values))


@cache
def _environment() -> jinja2.Environment:
    with optional_import("view", "the view"):
        import jinja2
    loader = jinja2.FileSystemLoader(Path(__file__).parent / "templates")
    environment = jinja2.Environment(
        loader=loader,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        auto_reload=False,
    )
    environment.globals.update(COLOURS)
    environment.filters.update(
        count=format_count,
        duration=format_duration,
        norm=norm,
        number=number,
        short=format_number,
        vector=vector,
        css=css,
    )
    return environment


def number(value: float) -> str:
    """Return a number in three digits; a rounding error as 0."""
    return "0" if abs(value) < ZERO else f"{value:.3g}"


def norm(components: Floats) -> str:
    """Return the length of a vector in three digits."""
    return number(float(np.linalg.norm(components)))


def vector(values: Floats) -> str:
    """Return numbers in three digits, in brackets; nothing for a single one."""
    return f"({', '.join(number(float(value)) for value in values)})" if len(values) > 1 else ""


def css(colour: Colours) -> str:
    """Return a colour (3,) as styles take it."""
    return f"rgb({','.join(map(str, colour.tolist()))})"
