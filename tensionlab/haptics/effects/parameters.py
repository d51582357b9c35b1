"""What parameters may an effect have? Refused before anything moves, by the effect's and the parameter's names."""

from __future__ import annotations

import math
from collections.abc import Iterable

from tensionlab.errors import EffectError


def _refuse(effect: object, name: str, what: str) -> None:
    raise EffectError(f"{type(effect).__name__}: {name} is {getattr(effect, name)!r}; give {what}")


def require_positive(effect: object, *names: str) -> None:
    """Refuse parameters that are not finite numbers above zero."""
    for name in names:
        if not (math.isfinite(getattr(effect, name)) and getattr(effect, name) > 0.0):
            _refuse(effect, name, "a finite number above 0")


def require_not_negative(effect: object, *names: str) -> None:
    """Refuse parameters that are not finite numbers of zero or more."""
    for name in names:
        if not (math.isfinite(getattr(effect, name)) and getattr(effect, name) >= 0.0):
            _refuse(effect, name, "a finite number, 0 or more")


def require_share(effect: object, *names: str) -> None:
    """Refuse parameters that are not between 0 and 1."""
    for name in names:
        if not 0.0 <= getattr(effect, name) <= 1.0:
            _refuse(effect, name, "a number from 0 to 1")


def require_point(effect: object, *names: str) -> None:
    """Refuse what is not a tuple of finite coordinates."""
    for name in names:
        if not _finite(getattr(effect, name)):
            _refuse(effect, name, "a tuple of finite coordinates, in m")


def require_direction(effect: object, *names: str) -> None:
    """Refuse what is not a tuple of finite components, or has no length."""
    for name in names:
        if not (_finite(getattr(effect, name)) and any(getattr(effect, name))):
            _refuse(effect, name, "a tuple of finite components, not all 0; its length does not matter")


def _finite(vector: object) -> bool:
    return isinstance(vector, Iterable) and all(isinstance(x, int | float) and math.isfinite(x) for x in vector)
