"""What is drawn of a state, as arrays: cables coloured by tension, arrows, the available forces, labels.

Everything is in space and in m; a rig in the plane lies in the plane z = 0. Forces are drawn to one scale, so that
the arrow of a force ends inside the set of available forces if and only if it is available.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tensionlab.model.kinematics import in_space
from tensionlab.model.pulleys import ways
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREY, ORANGE, PURPLE, Colours, ramp, rgb
from tensionlab.support.formatting import format_number
from tensionlab.viewer.evaluation import Evaluation
from tensionlab.viewer.snapping import outlines
from tensionlab.viewer.state import State, of_ghost
from tensionlab.viewer.volume import Mesh, bounds

FORCE_SHARE = 0.25
"""Of the size of a rig: about as long is the arrow of a force of the strongest module."""
TIP_SHARE = 0.045
"""Of the size of a rig: at least so far from the hand is where a force is grabbed."""
ARROWS = {"desired": ORANGE, "rendered": BLUE, "error": GREY, "certificate": PURPLE}
"""Colour of each arrow."""
SLACK_N = 1e-9
PLANE_SHARE = 0.7
"""Half of the edge of the plane of a certificate, as a share of the arrow of the strongest tension."""


@dataclass(frozen=True)
class Lines:
    """Line segments (k, 2, 3), in m, with colours of their ends (k, 2, 3)."""

    points: Floats
    colours: Colours


@dataclass(frozen=True)
class Arrow:
    """Arrow from a place to another, (3,), in m, and its colour."""

    start: Floats
    end: Floats
    colour: str


@dataclass(frozen=True)
class Label:
    """Text at a place, (3,), in m."""

    place: Floats
    text: str


@dataclass(frozen=True)
class Scene:
    """All that is drawn of a state, but the workspace.

    Attributes
    ----------
    cables, platform, ghost, walls : Lines
        Cables by tension, arms of the platform, the other rig, and the surfaces of the space.
    anchors : (m, 3) array
        Where the modules are.
    hand, tip : (3,) array
        Where the hand is, and where the arrow of the desired force is grabbed.
    labels : tuple of Label
        Name and tension of each module.
    arrows : dict of str to Arrow
        Some of `ARROWS`.
    available : Mesh or None
        Forces that are available at the hand.
    edges : Lines
        Of those.
    plane : Mesh or None
        Beyond which the desired force is certified to be.
    """

    cables: Lines
    platform: Lines
    ghost: Lines
    walls: Lines
    anchors: Floats
    hand: Floats
    tip: Floats
    labels: tuple[Label, ...]
    arrows: dict[str, Arrow]
    available: Mesh | None
    edges: Lines
    plane: Mesh | None


def draw(state: State, found: Evaluation) -> Scene:
    """Return what is drawn of a state and its evaluation."""
    anchors, ends, hand = (in_space(each) for each in (state.anchors, state.attachments, state.position))
    scale = force_scale(state.rig)
    force = in_space(state.wrench[: state.rig.dimension])
    available, edges = _available(found, hand, scale)
    certificate = _certificate(state, found, hand, scale)
    arrows = _arrows(state, found, hand, scale)
    if certificate is not None:
        arrows["certificate"] = certificate[0]
    return Scene(
        cables=cable_lines(_ways(state), tension_colours(state.rig, found)),
        platform=arms(hand, ends),
        ghost=_ghost(state),
        walls=_walls(state),
        anchors=anchors,
        hand=hand,
        tip=_tip(hand, scale * force, size(state.rig)),
        labels=_labels(state, found, anchors),
        arrows=arrows,
        available=available,
        edges=edges,
        plane=None if certificate is None else certificate[1],
    )


def _tip(hand: Floats, force: Floats, reach: float) -> Floats:
    """Return where the arrow of the desired force is grabbed: at its end, or beside the hand if it is short."""
    if float(np.linalg.norm(force)) >= TIP_SHARE * reach:
        return np.asarray(hand + force)
    return np.asarray(hand + TIP_SHARE * reach * np.array([0.8, 0.6, 0.0]))


def size(rig: Rig) -> float:
    """Return the longest edge of the box around a rig, in m."""
    low, high = bounds(rig)
    return float((high - low).max())


def force_scale(rig: Rig) -> float:
    """Return how many m are drawn for 1 N: a round number by which the strongest tension suits the rig's size."""
    wanted = FORCE_SHARE * size(rig) / max(float(rig.limits.upper.max()), SLACK_N)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1 + 1e-12))


def tension_colours(rig: Rig, found: Evaluation) -> Colours:
    """Return the colour of each cable, (m, 3), by where its tension is between its limits; grey without one."""
    tensions = np.full(rig.m, np.nan) if found.allocation is None else found.allocation.tensions
    return ramp(tensions, rig.limits.lower, rig.limits.upper)


def both_ends(colours: Colours) -> Colours:
    """Return the colours of lines, (k, 2, 3), each of one colour, (k, 3)."""
    return np.repeat(colours[:, None], 2, axis=1)


def cable_lines(ways: Floats, colours: Colours) -> Lines:
    """Return the lines of cables with points (k, m, 3) from the attachments on, each of one colour (m, 3)."""
    pieces = np.stack([ways[:-1], ways[1:]], axis=2).reshape(-1, 2, 3)
    return Lines(pieces, both_ends(np.tile(colours, (len(ways) - 1, 1))))


def _ways(state: State) -> Floats:
    pulleys = state.rig.pulleys_in_world(state.rig.at_rest)
    return in_space(ways(state.attachments, state.anchors, pulleys))


def _plain(points: Floats, colour: str) -> Lines:
    return Lines(points, np.broadcast_to(rgb(colour), (*points.shape[:2], 3)))


def arms(hand: Floats, ends: Floats) -> Lines:
    """Return lines from the reference point to the attachments; none for a point."""
    apart = ends[np.linalg.norm(ends - hand, axis=1) > 0.0]
    return _plain(np.stack([np.broadcast_to(hand, apart.shape), apart], axis=1), GREY)


def _ghost(state: State) -> Lines:
    """Return the cables of the other rig, from its anchors to the same hand."""
    other = state.ghost
    if other is None or other.dimension != state.rig.dimension:
        return _plain(np.empty((0, 2, 3)), GREY)
    shown = of_ghost(state, other)
    return cable_lines(_ways(shown), np.broadcast_to(rgb(GREY), (other.m, 3)))


def _walls(state: State) -> Lines:
    """Return the edges of the surfaces to which anchors snap."""
    if state.task is None:
        return _plain(np.empty((0, 2, 3)), GREY)
    return _plain(in_space(outlines(state.task.space)), GREY)


def _labels(state: State, found: Evaluation, anchors: Floats) -> tuple[Label, ...]:
    tensions: Any = [None] * state.rig.m if found.allocation is None else found.allocation.tensions
    return tuple(
        Label(place, module.name if tension is None else f"{module.name} · {format_number(tension)} N")
        for module, place, tension in zip(state.rig.modules, anchors, tensions, strict=True)
    )


def _arrows(state: State, found: Evaluation, hand: Floats, scale: float) -> dict[str, Arrow]:
    """Return the desired force, and where it is not rendered, the rendered one and what is missing."""
    d = state.rig.dimension
    desired = hand + scale * in_space(state.wrench[:d])
    arrows = {"desired": Arrow(hand, desired, ARROWS["desired"])}
    if found.allocation is not None and found.rendered is not None and found.allocation.status != Status.EXACT:
        rendered = hand + scale * in_space(found.rendered[:d])
        if np.isfinite(rendered).all():
            arrows["rendered"] = Arrow(hand, rendered, ARROWS["rendered"])
            arrows["error"] = Arrow(rendered, desired, ARROWS["error"])
    return arrows


def _available(found: Evaluation, hand: Floats, scale: float) -> tuple[Mesh | None, Lines]:
    """Return the faces and edges of the available forces, to scale around the hand."""
    if found.available is None:
        return None, _plain(np.empty((0, 2, 3)), BLUE)
    corners = hand + scale * in_space(found.available.corners)
    return Mesh(corners, found.available.faces), _plain(corners[found.available.edges], BLUE)


def _certificate(state: State, found: Evaluation, hand: Floats, scale: float) -> tuple[Arrow, Mesh] | None:
    """Return the direction that certifies the desired force infeasible, and the plane that it stands on.

    The plane touches the set of available forces, and the desired force is beyond it.
    """
    certificate = found.certificate
    if certificate is None:
        return None
    along, d = in_space(certificate.direction), state.rig.dimension
    foot = hand + scale * (in_space(state.wrench[:d]) + (certificate.reach - certificate.desired) * along)
    reach = PLANE_SHARE * scale * float(state.rig.limits.upper.max())
    aside = reach * np.linalg.svd(along[None])[2][1:]
    if d == 2:  # a line is seen there, from the front
        aside = reach * np.stack([np.cross(along, [0.0, 0.0, 1.0]), 0.03 * along])
    ring = foot + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ aside
    start = foot + aside[0]  # at the edge, clear of the other arrows
    return Arrow(start, start + reach * along, ARROWS["certificate"]), Mesh(ring, np.array([[0, 1, 2], [0, 2, 3]]))
