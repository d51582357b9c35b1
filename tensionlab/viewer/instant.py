"""What is drawn of an instant of a run, live or from its log, as arrays: measured tensions, and three forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tensionlab.model.kinematics import in_space
from tensionlab.model.pulleys import ARC_POINTS, ways
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREY, ORANGE, PURPLE, RED, Colours, ramp, rgb
from tensionlab.support.formatting import format_number
from tensionlab.viewer.scene import (
    Arrow,
    Label,
    Lines,
    arms,
    both_ends,
    cable_lines,
    force_scale,
    size,
)

BESIDE_COLOUR = PURPLE
"""Of what another solver would have commanded."""
ARROW_COLOURS = FORCE_COLOURS | {"beside": BESIDE_COLOUR}
ENLARGED = 2.0
"""Forces are drawn larger than on the design page, where they share the picture with the set of available ones."""
APART = 0.012
"""Share of the size of a rig by which arrows of forces are beside one another, so that equal ones are all seen."""
SLACK_SHARE = 0.5
"""A cable with less than this share of its lower limit is slack."""
STEPS = 2000
"""Of what is drawn along the longest edge of a rig: about those of a screen."""
DASHES = 24
"""Of a cable that is slack, or whose module is lost."""


@dataclass(frozen=True, eq=False)
class Beside:
    """What another solver would have commanded.

    Tensions (m,) in N, NaN where no set-point was sent, and the wrench (n,) in N and N·m of all modules.
    """

    solver: str
    tensions: Floats
    wrench: Floats


@dataclass(frozen=True, eq=False)
class Instant:
    """What a run knew in one cycle.

    Attributes
    ----------
    time : float
        Since the run began, in s.
    hand : (d,) array
        The point, or the platform's reference point, in m.
    anchors, ends : (m, d) arrays
        Ends of the cables, at the modules and at the platform, in m.
    tensions : (m,) array
        As measured, in N; before the first telemetry, as sent.
    set_points : (m,) array
        As sent, in N; NaN where none was.
    active : (m,) array of bool
        Modules that take part.
    desired, commanded, measured : (n,) arrays
        Wrenches in N and N·m; `desired` is NaN where none is.
    beside : Beside or None
        Of another solver, if one is asked.
    """

    time: float
    hand: Floats
    anchors: Floats
    ends: Floats
    tensions: Floats
    set_points: Floats
    active: NDArray[np.bool_]
    desired: Floats
    commanded: Floats
    measured: Floats
    beside: Beside | None = None

    @classmethod
    def of(cls, rig: Rig, cycle: Mapping[str, NDArray[Any]]) -> Instant:
        """Return the instant of a cycle, by the names of `CycleTable`."""
        structure, set_points, tensions = (cycle[name] for name in ("structure", "commanded", "measured"))
        desired = cycle["desired"]
        return cls(
            time=float(cycle["time"]),
            hand=cycle["position"],
            anchors=cycle["anchors"],
            ends=cycle["position"] + rig.attachments @ cycle["rotation"].T,
            tensions=np.where(np.isfinite(tensions), tensions, set_points),
            set_points=set_points,
            active=cycle["active"],
            desired=desired,
            commanded=structure @ np.nan_to_num(set_points) + not_the_solvers(cycle),
            measured=structure @ np.nan_to_num(tensions),
        )

    def slack(self, rig: Rig) -> NDArray[np.bool_]:
        """Return which cables (m,) of modules that take part are slack."""
        return np.asarray(self.active & (self.tensions < SLACK_SHARE * rig.limits.lower))


def not_the_solvers(cycle: Mapping[str, NDArray[Any]]) -> Floats:
    """Return what of the demanded wrench (n,) is not the solver's: impedances and lost modules pull it."""
    return np.asarray(np.nan_to_num(cycle["demanded"] - cycle["solver_wrench"]))


@dataclass(frozen=True, eq=False)
class InstantScene:
    """All that is drawn of an instant.

    Attributes
    ----------
    cables, platform : Lines
        Cables by measured tension, dashed where slack or lost, and arms of the platform.
    anchors, colours : (m, 3) arrays
        Where the modules are, in m, and their colours.
    hand : (3,) array
    labels : tuple of Label
        Name and tension of each module, or that it is slack or lost.
    arrows : dict of str to Arrow
        Of `FORCE_COLOURS`, those that are known; "beside", what another solver would have commanded.
    """

    cables: Lines
    platform: Lines
    anchors: Floats
    colours: Colours
    hand: Floats
    labels: tuple[Label, ...]
    arrows: dict[str, Arrow]


def draw(rig: Rig, instant: Instant, *, fresh: bool = True) -> InstantScene:
    """Return what is drawn of an instant; one that is not fresh is grey, and has neither tensions nor forces."""
    anchors, ends, hand = (_stepped(rig, in_space(each)) for each in (instant.anchors, instant.ends, instant.hand))
    slack = instant.slack(rig)
    dashed = slack | ~instant.active
    tensions = np.where(instant.active & fresh, instant.tensions, np.nan)
    bodies = np.array([module.frame in rig.frames for module in rig.modules])
    colours = np.where(bodies[:, None], rgb(ORANGE), rgb(BLUE))
    if not fresh:
        colours = np.broadcast_to(rgb(GREY), colours.shape)
    return InstantScene(
        cables=_cables(rig, ends, anchors, ramp(tensions, rig.limits.lower, rig.limits.upper), dashed),
        platform=arms(hand, ends),
        anchors=anchors,
        colours=np.where(instant.active[:, None], colours, rgb(RED)),
        hand=hand,
        labels=tuple(
            Label(place, module.name + (f" · {_word(tension, lost=not active, slack=loose)}" if fresh else ""))
            for module, place, tension, active, loose in zip(
                rig.modules, anchors, instant.tensions, instant.active, slack, strict=True
            )
        ),
        arrows=_arrows(rig, instant, hand) if fresh else {},
    )


def _stepped(rig: Rig, points: Floats) -> Floats:
    """Return the nearest points of a grid too fine to be seen: what only trembles need not be drawn again."""
    step = size(rig) / STEPS
    return np.asarray(np.round(points / step) * step)


def _word(tension: float, *, lost: bool, slack: bool) -> str:
    return "LOST" if lost else "slack" if slack else f"{format_number(float(tension))} N"


def _cables(rig: Rig, ends: Floats, anchors: Floats, colours: Colours, dashed: NDArray[np.bool_]) -> Lines:
    """Return cables as lines, those that are `dashed` (m,) as many short ones, straight ahead."""
    d = rig.dimension
    pulleys = None if rig.frames else rig.pulleys  # where bodies are turned to is not known here
    points = np.zeros((1 + (1 if pulleys is None else ARC_POINTS), *ends.shape))
    points[..., :d] = ways(ends[:, :d], anchors[:, :d], pulleys)
    whole = cable_lines(points[:, ~dashed], colours[~dashed])
    marks = np.arange(2 * DASHES).reshape(-1, 2) / (2 * DASHES - 1)
    pieces, shades = [whole.points], [whole.colours]
    for index in np.flatnonzero(dashed):
        pieces.append(ends[index] + marks[..., None] * (anchors[index] - ends[index]))
        shades.append(both_ends(np.broadcast_to(colours[index], (DASHES, 3))))
    return Lines(np.concatenate(pieces), np.concatenate(shades))


def _arrows(rig: Rig, instant: Instant, hand: Floats) -> dict[str, Arrow]:
    """Return the arrows of the forces from the hand, to scale, beside one another."""
    scale, d = ENLARGED * force_scale(rig), rig.dimension
    wrenches: dict[str, Floats] = {name: getattr(instant, name) for name in FORCE_COLOURS}
    if instant.beside is not None:
        wrenches["beside"] = instant.beside.wrench
    forces = {name: in_space(wrench[:d]) for name, wrench in wrenches.items()}
    known = {name: force for name, force in forces.items() if np.isfinite(force).all() and force.any()}
    if not known:
        return {}
    along = next(iter(known.values()))
    up = in_space(rig.upward) if d == 3 and rig.up is not None else np.array([0.0, 0.0, 1.0])
    aside = np.cross(along, up)
    if float(np.linalg.norm(aside)) < 0.1 * float(np.linalg.norm(along)):
        aside = np.cross(along, np.roll(up, 1))
    aside *= APART * size(rig) / float(np.linalg.norm(aside))
    found = {}
    for (name, colour), steps in zip(ARROW_COLOURS.items(), (0.0, 1.0, -1.0, 2.0), strict=True):
        if name in known:
            start = _stepped(rig, hand + steps * aside)
            found[name] = Arrow(start, start + _stepped(rig, scale * known[name]), colour)
    return found
