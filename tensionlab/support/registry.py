"""Objects by name: a class, and after a colon its first hyper-parameter, as in ``qp:osqp``."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import Field, fields
from difflib import get_close_matches
from typing import Any

from tensionlab.errors import TensionlabError


def create_by_name(
    name: str, kind: type[Any] | None, names: Iterable[str], what: str, error: type[TensionlabError]
) -> Any:
    """Return an object of the class ``kind`` under the first part of a name; its other part sets the variant.

    The error, which says ``what`` the names are of, such as "solver", is raised if no class was found, or it has
    no such variant.
    """
    family, colon, choice = name.partition(":")
    if kind is None:
        raise error(f"no {what} is called {family!r}; {suggest(family, names)}")
    if not colon:
        return kind()
    first = variant_field(kind)
    if first is None:
        raise error(f"{family!r} has no variants, so {name!r} means nothing; write {family!r}")
    try:
        default: Any = first.default
        value = type(default)(choice)
    except ValueError:
        wanted = {float: "a number", int: "a whole number"}.get(type(default), "another")
        raise error(f"in {name!r}, {choice!r} is no value for {family}'s {first.name}; give {wanted}") from None
    return kind(**{first.name: value})


def suggest(name: str, names: Iterable[str], listing: str = "") -> str:
    """Return advice about an unknown name: the one that looks like it, or else where they are listed, or all."""
    close = get_close_matches(name, names, n=1) or [known for known in names if name and known.startswith(name)]
    return f"did you mean {close[0]!r}?" if close else listing or f"choose one of {', '.join(names)}"


def variant_field(kind: type[Any]) -> Field[Any] | None:
    """Return the hyper-parameter that a name can set: the first, if it is a number or a text."""
    parameters = fields(kind)
    return parameters[0] if parameters and isinstance(parameters[0].default, (int, float, str)) else None
