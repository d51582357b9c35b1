"""One translator of pydantic's validation errors into messages: where, what is wrong, what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache, wraps
from itertools import accumulate
from os import PathLike
from typing import Any, TypeVar, get_args, get_type_hints

from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from tensionlab.errors import TensionlabError
from tensionlab.support.files.reading import brief
from tensionlab.support.registry import suggest

T = TypeVar("T")
MAX_PROBLEMS_CHARACTERS = 220  # length of a message beyond which advice, and then further problems, are left out
TABLE = "a table of keys and values"
WANTED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "string_too_short": "a text that is not empty",
    "string_too_long": "{max_length} characters at most",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": TABLE,
    "mapping_type": TABLE,
    "model_type": TABLE,
    "model_attributes_type": TABLE,
    "dataclass_type": TABLE,
    "too_short": "{min_length} or more",
    "too_long": "{max_length} at most",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "literal_error": "{expected}",
    "is_instance_of": "an instance of {class}",
}  # what to give, by pydantic's type of error


def validate(kind: type[T], values: object, error: type[TensionlabError], source: str | PathLike[str] = "") -> T:
    """Return an object of a model, dataclass or other type from the values of a document.

    ``kind`` is a pydantic model, a dataclass or an annotated type. The error has a line for each problem and
    begins with ``source``, the name of the document.
    """
    try:
        checked: T = _adapter(kind).validate_python(values)  # type: ignore[arg-type]
        return checked
    except ValidationError as problem:
        message = explain(problem, kind, values)
        raise error(f"{source}: {message}" if source else message) from None


def raises(error: type[TensionlabError]) -> Callable[[type[T]], type[T]]:
    """Make a pydantic dataclass or model raise the error, in our words, where its constructor refuses."""

    def decorate(kind: type[T]) -> type[T]:
        construct: Any = kind.__init__

        @wraps(construct)
        def init(self: T, *args: Any, **kwargs: Any) -> None:
            named = dict(zip(_fields(kind), args, strict=False)) | kwargs  # pydantic numbers positional ones
            try:
                construct(self, **named)
            except ValidationError as problem:
                raise error(f"{kind.__name__}: {explain(problem, kind, named)}") from None

        setattr(kind, "__init__", init)  # noqa: B010 - mypy takes no assignment to a method
        return kind

    return decorate


def describe(value: object) -> str:
    """Return a value in short, as JSON has it."""
    return "null" if value is None else brief(value)


def take_kind(
    table: object, kinds: Mapping[str, type[Any]], key: str = "kind"
) -> tuple[type[Any], dict[str, Any]]:
    """Return the class that a table names by a key, and the rest; `ValueError` if it names none."""
    known = ", ".join(kinds)
    if not isinstance(table, Mapping):
        raise ValueError(f"is {describe(table)}; give {TABLE} with its {key}")
    if key not in table:
        raise ValueError(f"{key} is missing; give one of {known}")
    name = table[key]
    if not isinstance(name, str) or name not in kinds:
        raise ValueError(f"{key} is {describe(name)}; give one of {known}")
    return kinds[name], {other: value for other, value in table.items() if other != key}


def explain(error: ValidationError, kind: Any = None, values: object = None) -> str:
    """Return the problems in words, such as ``modules[0] ("left"): lower is 'a'; give a number``.

    With ``kind``, the type, messages suggest keys and describe what to give; with ``values``, the validated ones,
    they name entries of lists and leave out steps that are no keys.
    """
    # Pydantic counts no entries that have problems of their own, and then finds a list too short as well.
    problems = [
        problem
        for problem in error.errors(include_url=False)
        if problem["type"] != "too_short" or len(problem["input"]) < problem["ctx"]["min_length"]
    ]
    lines = [_explain(problem, kind, values) for problem in problems]
    if len(lines) == 1:
        return lines[0]
    count = len(lines)
    if sum(map(len, lines)) > MAX_PROBLEMS_CHARACTERS:
        lines = [line.partition("; ")[0] for line in lines]
        fitting = sum(length <= MAX_PROBLEMS_CHARACTERS for length in accumulate(map(len, lines)))
        lines = lines[: max(fitting, 1)]
    more = [f"and {count - len(lines)} more"] if len(lines) < count else []
    return "\n  ".join([f"{count} problems:", *lines, *more])


def _explain(problem: ErrorDetails, kind: Any, values: object) -> str:
    path, type_of_error = problem["loc"], problem["type"]
    where, known, field = _place(path, values), *_fields_along(path, kind)
    if type_of_error in ("value_error", "assertion_error"):
        text = problem["msg"].partition(", ")[2]
        return f"{where.removesuffix(': ')}: {text}" if where else text
    if type_of_error in ("extra_forbidden", "unexpected_keyword_argument"):
        listing = f"the keys here are {', '.join(known)}" if known else "leave it out"
        return f"{where} is an unknown key; {suggest(str(path[-1]), known, listing)}"
    description = (field.description if field is not None else None) or ""
    meaning = " ".join(description.split()).rstrip(".")
    if type_of_error in ("missing", "missing_argument"):
        return f"{where} is missing; give {meaning or 'it'}"
    subject = where if where and not where.endswith(": ") else f"{where}it"
    value = problem["input"]
    given = f"is {describe(value)}"
    if type_of_error in ("too_short", "too_long") and isinstance(value, Sequence | Mapping):
        given = f"has {len(value)} entries"
    expected = WANTED.get(type_of_error, f"another value ({problem['msg'][:1].lower()}{problem['msg'][1:]})")
    wanted = expected.format(**problem.get("ctx", {}))
    bounds = _bounds(field) if type_of_error.startswith(("greater", "less")) else {}
    if {"ge", "le"} <= set(bounds):
        wanted = "{ge:g} to {le:g}".format(**bounds)
    elif {"gt", "le"} <= set(bounds):
        wanted = "more than {gt:g}, up to {le:g}".format(**bounds)
    return f"{subject} {given}; give {wanted}{f' ({meaning})' if meaning else ''}"


def _bounds(field: FieldInfo | None) -> dict[str, float]:
    """Return the bounds of a number, by their names in pydantic."""
    marks = () if field is None else field.metadata
    return {key: getattr(mark, key) for mark in marks for key in ("gt", "ge", "lt", "le") if hasattr(mark, key)}


def _place(path: Sequence[str | int], values: object) -> str:
    """Return a path in words, such as ``modules[0] ("left"): anchor[1]``; steps that are no keys are left out."""
    text, inside = "", values
    for number, step in enumerate(path):
        last = number == len(path) - 1
        if isinstance(step, int):
            text += f"[{step}]"
            inside = inside[step] if isinstance(inside, list | tuple) and step < len(inside) else None
            name = inside.get("name") if isinstance(inside, Mapping) else None
            text += f' ("{name!s:.40}"): ' if name else ""
        elif step == "[key]":  # pydantic's mark of a problem with the key itself
            continue
        elif not isinstance(inside, Mapping) or step in inside or last:
            text += f"{'.' if text and not text.endswith(': ') else ''}{step!s:.40}"
            inside = inside.get(step) if isinstance(inside, Mapping) else None
    return text


def _fields_along(path: Sequence[str | int], kind: Any) -> tuple[list[str], FieldInfo | None]:
    """Return the known keys in the table that a path leads into, and the field of the last known step."""
    models, field = list(_models(kind)), None
    known: list[str] = []
    for step in path:
        here = {name: field for model in models for name, field in _fields(model).items()}
        known = list(here) or known
        if step in here:
            field = here[str(step)]
            models = list(_models(field.annotation))
        elif isinstance(step, str):
            field = None
    return known, field


def _models(annotation: Any) -> Iterator[Any]:
    """Yield every model or dataclass inside an annotation."""
    if _fields(annotation):
        yield annotation
        return
    for part in get_args(annotation):
        yield from _models(part)


def _fields(kind: Any) -> dict[str, FieldInfo]:
    """Return the fields of a model or dataclass; none of any other type."""
    if not isinstance(kind, type):
        return {}
    if is_dataclass(kind) and not hasattr(kind, "__pydantic_fields__"):
        hints = get_type_hints(kind, include_extras=True)
        return {field.name: FieldInfo.from_annotation(hints[field.name]) for field in fields(kind)}
    return dict(getattr(kind, "__pydantic_fields__", {}))


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
