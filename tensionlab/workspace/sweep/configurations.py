"""Configurations of a sweep: rigs, or every combination of the values of some parameters (`vary`)."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from tensionlab.errors import SweepError
from tensionlab.model import layouts
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import as_floats
from tensionlab.workspace.poses import Label, label


class Axis(NamedTuple):
    """Parameter that differs between the rigs: its name, its values, and their labels."""

    name: str
    values: tuple[Any, ...]
    labels: dict[str, Label]


@dataclass(frozen=True, eq=False)
class Configurations:
    """Every combination of the values of some axes; ``make`` returns the rig with one value for each axis."""

    axes: tuple[Axis, ...]
    make: Callable[..., Rig]

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(axis.name for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def rig(self, index: Sequence[int]) -> Rig:
        """Return the rig with these indices along the axes."""
        return self.make(*(axis.values[i] for axis, i in zip(self.axes, index, strict=True)))

    def rigs(self) -> Iterator[Rig]:
        """Yield the rig of every combination; the last axis runs fastest."""
        return (self.rig(index) for index in np.ndindex(*self.shape))

    def labels(self) -> dict[str, Label]:
        """Return the labels of the axes."""
        return {name: each for axis in self.axes for name, each in axis.labels.items()}


def vary(
    what: Rig | Sequence[Rig] | Callable[..., Rig],
    *,
    limits: Sequence[tuple[float, float]] | None = None,
    **parameters: Any,
) -> Configurations:
    """Return the rigs of every combination of these values.

    The axes are "rig" or one for each listed parameter, and "limits". SweepError names the argument: no values,
    values of no use, names that are not the layout's.

    Parameters
    ----------
    what : Rig, sequence of Rig, or callable
        Rigs with names that differ, or a layout: a function whose arguments are the parameters.
    limits : sequence of (lower, upper), optional
        Tension limits to try, the same for all modules, in N.
    **parameters
        Of the layout: a list of the values to try, or one value that stays.

    Examples
    --------
    >>> import tensionlab as tl
    >>> configurations = tl.workspace.vary(tl.ring_plus_top, side=[0.5, 1.0], count=[3, 4, 5])
    >>> swept = tl.sweep(configurations, [[0.0, 0.3, 0.0]], "capacity-margin")
    >>> dict(swept["capacity-margin"].sizes)
    {'side': 2, 'count': 3, 'pose': 1}
    """
    axes, make = _layout(what, parameters) if callable(what) else _rigs(what, parameters)
    if limits is None:
        return Configurations(tuple(axes), make)
    pairs = as_floats("limits", limits)
    if pairs.ndim != 2 or pairs.size == 0 or pairs.shape[1] != 2:
        raise SweepError(f"vary: limits is {limits!r}; give a list of pairs (lower, upper) in N")
    axes.append(_axis("limits", pairs.tolist(), "N", "tension limits", ("lower", "upper")))

    def configure(*values: Any) -> Rig:
        *others, (lower, upper) = values
        rig = make(*others)
        return replace(rig, modules=tuple(replace(each, lower=lower, upper=upper) for each in rig.modules))

    return Configurations(tuple(axes), configure)


def _rigs(what: Rig | Sequence[Rig], parameters: Mapping[str, Any]) -> tuple[list[Axis], Callable[..., Rig]]:
    """Return the axis "rig", and a function that makes a rig of its value."""
    if parameters:
        raise SweepError(f"vary: {next(iter(parameters))!r} is the parameter of a layout, and this is no layout")
    rigs = [what] if isinstance(what, Rig) else list(what)
    if not rigs:
        raise SweepError("rigs is empty; give at least one rig")
    if other := [each for each in rigs if not isinstance(each, Rig)]:
        raise SweepError(f"rigs holds {other[0]!r}; give rigs, such as tl.load_rig returns, or what vary returns")
    names = [each.name for each in rigs]
    if twice := [name for name in names if names.count(name) > 1]:
        raise SweepError(f'two rigs are called "{twice[0]}"; give each its own name')
    labels = {"rig": label(("rig",), np.array(names), "1", "name of the rig")}
    return [Axis("rig", tuple(rigs), labels)], lambda rig: rig


def _layout(what: Callable[..., Rig], parameters: Mapping[str, Any]) -> tuple[list[Axis], Callable[..., Rig]]:
    """Return an axis for each parameter with several values, and a function that makes the rig."""
    title = getattr(what, "__name__", "the layout")
    known = inspect.signature(what).parameters
    if unknown := [name for name in parameters if name not in known]:
        raise SweepError(f"vary: {title} has no parameter {unknown[0]!r}; it has {', '.join(known)}")
    if needed := [name for name, each in known.items() if each.default is each.empty and name not in parameters]:
        raise SweepError(f"vary: {title} needs {needed[0]!r}; give a value, or a list of values to try")
    axes, fixed = [], {}
    for name, values in parameters.items():
        if isinstance(values, str) or not isinstance(values, (Sequence, np.ndarray)):
            fixed[name] = values
            continue
        listed = list(values)
        if not listed:
            raise SweepError(f"vary: {name} holds no values; give at least one")
        counts = all(isinstance(value, (int, np.integer)) for value in listed)
        unit = layouts.UNITS.get(name, "1" if counts else "SI")
        axes.append(_axis(name, listed, unit, f"{name} of {title}"))
    names = [axis.name for axis in axes]
    return axes, lambda *values: what(**fixed, **dict(zip(names, values, strict=True)))


def _axis(name: str, values: Sequence[Any], unit: str, title: str, parts: Sequence[str] = "xyz") -> Axis:
    """Return an axis: numbers and texts label themselves, points have a number and coordinates."""
    if all(isinstance(value, str) for value in values):
        return Axis(name, tuple(values), {name: label((name,), np.array(values), "1", title)})
    try:
        table = np.array([np.nan if value is None else value for value in values])
    except ValueError:
        table = np.array(None)
    if table.dtype.kind not in "biuf" or table.ndim not in (1, 2):
        raise SweepError(f"vary: {name} is {values!r}; give numbers, texts, or points of one dimension")
    if table.ndim == 1:
        return Axis(name, tuple(values), {name: label((name,), table, unit, title)})
    labels = {name: label((name,), np.arange(len(values)), "1", f"number of the {title}")}
    for i, column in enumerate(table.T):
        part = parts[i] if i < len(parts) else str(i)
        labels[f"{name}_{part}"] = label((name,), column, unit, f"{part} of the {title}")
    return Axis(name, tuple(values), labels)
