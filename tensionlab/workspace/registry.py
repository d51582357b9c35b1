"""Every measure that a sweep can take: the table, and the names by which they are asked for."""

from __future__ import annotations

import difflib
from dataclasses import fields
from typing import Any

from tensionlab.errors import SweepError
from tensionlab.workspace.base import Measure
from tensionlab.workspace.metrics import (
    BodyDistance,
    CableDistance,
    CapacityMargin,
    ConditionNumber,
    IsotropicForce,
    LeastSingularValue,
    ReachableShare,
    SquaredTension,
    TensionFactor,
    WrenchClosure,
)

MEASURES: dict[str, type[Any]] = {
    "capacity-margin": CapacityMargin,
    "wrench-closure": WrenchClosure,
    "tension-factor": TensionFactor,
    "isotropic-force": IsotropicForce,
    "reachable-share": ReachableShare,
    "least-singular-value": LeastSingularValue,
    "condition-number": ConditionNumber,
    "effort": SquaredTension,
    "cable-distance": CableDistance,
    "body-distance": BodyDistance,
}
"""Measures by name. A new one is a class above and a line here."""


def make(word: str) -> Measure:
    """Which measure does this name mean?

    Parameters
    ----------
    word : str
        A name in `MEASURES`. What follows a colon sets the first hyper-parameter: ``"reachable-share:2.0"`` is
        ``ReachableShare(magnitude=2.0)``.

    Raises
    ------
    SweepError
        If there is no such name, or the measure refuses the hyper-parameter.
    """
    family, colon, choice = word.partition(":")
    if family not in MEASURES:
        close = difflib.get_close_matches(family, MEASURES, n=1)
        hint = f"did you mean {close[0]!r}?" if close else f"choose one of {', '.join(MEASURES)}"
        raise SweepError(f"no measure is called {family!r}; {hint}")
    parameters = fields(MEASURES[family])
    if not colon:
        found: Measure = MEASURES[family]()
        return found
    if not parameters or not isinstance(parameters[0].default, (float, str)):
        raise SweepError(f"{family!r} has no variants, so {word!r} means nothing; write {family!r}")
    first = parameters[0]
    default: Any = first.default
    try:
        value = default.__class__(choice)
    except ValueError:
        raise SweepError(f"in {word!r}, {choice!r} is no value for {family}'s {first.name}") from None
    variant: Measure = MEASURES[family](**{first.name: value})
    return variant


def name(measure: Measure) -> str:
    """Under which name would `make` make this measure? Only the first hyper-parameter is in it.

    A measure from elsewhere is called like its class.
    """
    names = [each for each, kind in MEASURES.items() if type(measure) is kind]
    if not names:
        return type(measure).__name__
    family = names[0]
    parameters = fields(MEASURES[family])
    if not parameters or not isinstance(parameters[0].default, (float, str)):
        return family
    value = getattr(measure, parameters[0].name)
    return family if value == parameters[0].default else f"{family}:{value}"


def question(measure: Measure) -> str:
    """Which question does a measure answer? The first line of its docstring."""
    return (type(measure).__doc__ or "").partition("\n")[0]
