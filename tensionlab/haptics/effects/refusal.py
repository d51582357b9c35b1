"""Refusals of values from messages and files in words: the key, what is wrong with it, and what to give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from tensionlab.support.files.reading import brief

OWN_WORDS = "value_error"
"""Kind of problem whose text is this project's already."""
WANTED = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "tuple_type": "a list of numbers",
    "list_type": "a list",
    "dict_type": "an object, with names as keys",
    "mapping_type": "an object, with names as keys",
    "model_type": "an object",
    "model_attributes_type": "an object",
    "dataclass_type": "an object of parameters",
    "string_too_short": "a text that is not empty",
    "greater_than_equal": "{ge:g} or more",
    "less_than_equal": "{le:g} or less",
    "string_too_long": "{max_length} characters at most",
    "too_long": "{max_length} at most",
    "too_short": "{min_length} or more",
}
"""What to give, by the kinds of pydantic's problems."""


def shown(value: object) -> str:
    """Return a value in short, for a message to who wrote it in JSON."""
    return "null" if value is None else brief(value)


def first_problem(error: ValidationError, leave_out: tuple[str, ...] = (), wanted: str = "") -> str:
    """Return in words what is wrong first: ``time is 'x'; give a number``.

    Parameters
    ----------
    error : ValidationError
    leave_out : tuple of str
        Steps of the way to the value that are no keys.
    wanted : str
        What to give, where it is known better than by the type, such as a range with its unit.
    """
    problem = error.errors(include_url=False)[0]
    where = ".".join(str(step) for step in problem["loc"] if step not in leave_out and step != "[key]")
    if problem["type"] == OWN_WORDS:
        text = problem["msg"].removeprefix("Value error, ")
        return f"{where}: {text}" if where else text
    if problem["type"] in ("missing", "missing_argument"):
        return f"{where} is missing; give it"
    if problem["type"] == "extra_forbidden":
        return f"{where} is not known; leave it out"
    return f"{where or 'it'} {_given(problem)}; give {wanted or _wanted(problem)}"


def _given(problem: ErrorDetails) -> str:
    value = problem["input"]
    if problem["type"] in ("too_long", "too_short") and isinstance(value, list | tuple | Mapping):
        return f"has {len(value)} entries"
    return f"is {shown(value)}"


def _wanted(problem: ErrorDetails) -> str:
    context: Mapping[str, Any] = problem.get("ctx", {})
    if problem["type"] in WANTED:
        return WANTED[problem["type"]].format(**context)
    return f"another value ({problem['msg'][:1].lower()}{problem['msg'][1:]})"
