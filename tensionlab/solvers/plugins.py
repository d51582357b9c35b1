"""Solvers that other distributions bring: the entry point group ``tensionlab.solvers``.

Nothing here runs on ``import tensionlab``: distributions are looked through when a name is asked for that the
house does not have, or when all solvers are listed.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection
from dataclasses import is_dataclass
from typing import TYPE_CHECKING, Any

from tensionlab.errors import PluginError
from tensionlab.solvers.base import POLICIES

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

GROUP = "tensionlab.solvers"
PARTS: dict[str, Any] = {"objective": str, "policies": tuple, "solve": Callable}
"""What the class of a solver has, and of which kind."""


def offered() -> dict[str, list[EntryPoint]]:
    """Which solvers do other distributions offer, by name? None of their code is run."""
    from importlib.metadata import entry_points

    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=GROUP):
        found.setdefault(entry.name, []).append(entry)
    return found


def find(name: str) -> type[Any] | None:
    """Which class does another distribution offer under this name?

    Returns
    -------
    class or None
        None if no distribution offers the name.

    Raises
    ------
    PluginError
        If several do, or what is offered cannot be loaded or is no solver. It names the distribution.
    """
    entries = offered().get(name)
    return _only(entries) if entries else None


def find_all(taken: Collection[str]) -> dict[str, type[Any] | PluginError]:
    """Which solvers do other distributions bring, and what is wrong with those that cannot be used?

    Parameters
    ----------
    taken : collection of str
        Names of the house, which nobody else can have.
    """
    found: dict[str, type[Any] | PluginError] = {}
    for name, entries in offered().items():
        try:
            if name in taken:
                raise PluginError(
                    f"{_origins(entries)} offers a solver {name!r}; tensionlab has its own of that name"
                )
            found[name] = _only(entries)
        except PluginError as error:
            found[name] = error
    return found


def _origins(entries: list[EntryPoint]) -> str:
    """Names and versions of the distributions that entry points belong to."""
    return " and ".join(f"{each.dist.name} {each.dist.version}" if each.dist else "nobody" for each in entries)


def _only(entries: list[EntryPoint]) -> type[Any]:
    entry, *others = entries
    if others:
        raise PluginError(f"a solver {entry.name!r} is offered by {_origins(entries)}; uninstall all but one")
    if ":" in entry.name:
        raise PluginError(
            f"{_origins(entries)} offers a solver {entry.name!r}; no name has a colon, it sets a variant"
        )
    return _load(entry)


@functools.cache
def _load(entry: EntryPoint) -> type[Any]:
    """The class that an entry point means, checked to be a solver; loaded once."""
    where = f"solver {entry.name!r} of {_origins([entry])} ({entry.value})"
    try:
        found = entry.load()
        if isinstance(found, type):
            found()
    except Exception as error:  # the code of others may raise anything
        raise PluginError(f"{where} cannot be loaded: {type(error).__name__}: {error}") from error
    lacks = [name for name, kind in PARTS.items() if not isinstance(getattr(found, name, None), kind)]
    if not (isinstance(found, type) and is_dataclass(found)) or lacks:
        what = f"lacks {', '.join(lacks)}" if lacks else "is no dataclass"
        raise PluginError(f"{where} {what}; tensionlab.solvers.base says what a solver is")
    solver_class: type[Any] = found
    if unknown := [each for each in solver_class.policies if each not in POLICIES]:
        raise PluginError(f"{where} has a policy {unknown[0]!r}; there are {', '.join(POLICIES)}")
    return solver_class
