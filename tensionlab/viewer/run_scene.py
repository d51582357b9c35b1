"""Data of a run in one cycle, and how they are drawn: cables by measured tension, modules and forces."""

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
from tensionlab.support.colours import FORCE_COLOURS, GREY, RED, Colours, ramp, rgb
from tensionlab.support.formatting import format_number
from tensionlab.viewer.scene import (
    Arrow,
    Lines,
    RigScene,
    cable_lines,
    force_scale,
    module_colours,
    platform_lines,
    size,
)

# Length of the arrows of forces against those of the design page, which shows all available forces too.
ENLARGED = 2.0
APART = 0.012  # distance between arrows of equal forces, as a share of the size of the rig
SLACK_SHARE = 0.5  # share of its lower limit below which a cable is slack
DASHES = 24  # dashes along a cable that is slack, or whose module is lost


@dataclass(frozen=True, eq=False)
class Instant:
    """Data of a run in one cycle.

    Attributes
    ----------
    time : float
        Time since the run began, in s.
    hand : (d,) array
        The point, or the platform's reference point, in m.
    anchors, ends : (m, d) arrays
        Ends of the cables, at the modules and at the platform, in m.
    tensions : (m,) array
        Measured tensions in N; before the first telemetry, those sent.
    set_points : (m,) array
        Tensions sent, in N; NaN where none was.
    active : (m,) array of bool
        Modules that take part.
    desired, commanded, measured : (n,) arrays
        Wrenches in N and N·m; `desired` is NaN where none is.
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

    @classmethod
    def of(cls, rig: Rig, cycle: Mapping[str, NDArray[Any]]) -> Instant:
        """Return the instant of a cycle, by the names of `CycleTable`."""
        structure, set_points, tensions = (cycle[name] for name in ("structure", "commanded", "measured"))
        by_modules = np.nan_to_num(cycle["demanded"] - cycle["solver_wrench"])  # impedances and lost modules
        return cls(
            time=float(cycle["time"]),
            hand=cycle["position"],
            anchors=cycle["anchors"],
            ends=cycle["position"] + rig.attachments @ cycle["rotation"].T,
            tensions=np.where(np.isfinite(tensions), tensions, set_points),
            set_points=set_points,
            active=cycle["active"],
            desired=cycle["desired"],
            commanded=structure @ np.nan_to_num(set_points) + by_modules,
            measured=structure @ np.nan_to_num(tensions),
        )

    def slack(self, rig: Rig) -> NDArray[np.bool_]:
        """Return which cables (m,) of modules that take part are slack."""
        return np.asarray(self.active & (self.tensions < SLACK_SHARE * rig.limits.lower))

    def colours(self, rig: Rig, *, fresh: bool = True) -> Colours:
        """Return the colour of each cable (m, 3) by its tension; grey for a lost module, or if not fresh."""
        tensions = np.where(self.active & fresh, self.tensions, np.nan)
        return ramp(tensions, rig.limits.lower, rig.limits.upper)


def draw_instant(rig: Rig, instant: Instant, *, fresh: bool = True) -> RigScene:
    """Return how an instant is drawn; one that is not fresh is grey, and has neither tensions nor forces."""
    anchors, ends, hand = (in_space(points) for points in (instant.anchors, instant.ends, instant.hand))
    colours = module_colours(rig) if fresh else np.tile(rgb(GREY), (rig.m, 1))
    return RigScene(
        cables=_cables(rig, instant, ends, anchors, fresh=fresh),
        platform=platform_lines(hand, ends),
        anchors=anchors,
        colours=np.where(instant.active[:, None], colours, rgb(RED)),
        hand=hand,
        labels=tuple(
            f"{module.name} · {tension_text(instant, rig, i)}" if fresh else module.name
            for i, module in enumerate(rig.modules)
        ),
        arrows=_arrows(rig, instant, hand) if fresh else {},
    )


def tension_text(instant: Instant, rig: Rig, index: int) -> str:
    """Return the tension of a module, or that it is lost or its cable slack."""
    if not instant.active[index]:
        return "LOST"
    return "slack" if instant.slack(rig)[index] else f"{format_number(float(instant.tensions[index]))} N"


def _cables(rig: Rig, instant: Instant, ends: Floats, anchors: Floats, *, fresh: bool) -> Lines:
    """Return cables as lines; those that are slack, or of lost modules, as straight dashes."""
    d, colours = rig.dimension, instant.colours(rig, fresh=fresh)
    dashed = instant.slack(rig) | ~instant.active
    pulleys = None if rig.frames else rig.pulleys  # how bodies have turned is not known here
    points = np.zeros((1 + (1 if pulleys is None else ARC_POINTS), *ends.shape))
    points[..., :d] = ways(ends[:, :d], anchors[:, :d], pulleys)
    whole = cable_lines(points[:, ~dashed], colours[~dashed])
    marks = np.linspace(0.0, 1.0, 2 * DASHES).reshape(-1, 2, 1)
    dashes = [ends[i] + marks * (anchors[i] - ends[i]) for i in np.flatnonzero(dashed)]
    return Lines(
        np.concatenate([whole.points, *dashes]),
        np.concatenate([whole.colours, np.repeat(colours[dashed], DASHES, axis=0)]),
    )


def _arrows(rig: Rig, instant: Instant, hand: Floats) -> dict[str, Arrow]:
    """Return the arrows of the forces from the hand, to scale, next to each other so that equal ones show."""
    forces = {name: in_space(getattr(instant, name)[: rig.dimension]) for name in FORCE_COLOURS}
    known = {name: force for name, force in forces.items() if np.isfinite(force).all() and force.any()}
    if not known:
        return {}
    first = next(iter(known.values()))
    up = in_space(rig.upward) if rig.dimension == 3 and rig.up is not None else np.array([0.0, 0.0, 1.0])
    across = np.cross(first, up)
    if float(np.linalg.norm(across)) < 0.1 * float(np.linalg.norm(first)):
        across = np.cross(first, np.roll(up, 1))
    across *= APART * size(rig) / float(np.linalg.norm(across))
    scale = ENLARGED * force_scale(rig)
    steps = dict(zip(FORCE_COLOURS, (0.0, 1.0, -1.0), strict=True))
    return {
        name: Arrow(hand + steps[name] * across, hand + steps[name] * across + scale * force)
        for name, force in known.items()
    }
