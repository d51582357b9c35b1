"""Names that are retired: they warn until they are removed (docs/project/stability.md)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def deprecated(*, since: str, removed_in: str, instead: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Mark a function, a method, or with its ``__init__`` a class as deprecated: calls warn at their own line.

    ``since`` and ``removed_in`` are versions such as "1.1", ``instead`` is what to write.
    """

    def mark(target: Callable[P, R]) -> Callable[P, R]:
        name = target.__qualname__.removesuffix(".__init__")
        message = f"{name} is deprecated since tensionlab {since} and removed in {removed_in}; use {instead}"

        @wraps(target)
        def warned(*values: P.args, **options: P.kwargs) -> R:
            warnings.warn(message, DeprecationWarning, stacklevel=2)
            return target(*values, **options)

        return warned

    return mark
