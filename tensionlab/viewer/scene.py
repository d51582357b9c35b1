"""The scene of a state as arrays: cables coloured by tension, arrows, the available forces, labels.

Everything is in space and in m; a rig in the plane lies in the plane z = 0. Forces are drawn to one scale, so that
the arrow of a force ends inside the set of available forces if and only if it is available.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tensionlab.model.kinematics import in_space
from tensionlab.model.pulleys import ways
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import Status
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import BLUE, GREY, ORANGE, PURPLE, Colours, ramp, rgb
from tensionlab.support.formatting import format_number
from tensionlab.viewer.evaluation import StateEvaluation
from tensionlab.viewer.state import DesignState, ghost_state, outlines
from tensionlab.viewer.workspace import Mesh, bounds

FORCE_SHARE = 0.25  # length of the arrow of the strongest tension, about, as a share of the size of the rig
TIP_SHARE = 0.045  # least distance from the hand at which a force is grabbed, as a share of the size of the rig
ARROWS = {"desired": ORANGE, "rendered": BLUE, "error": GREY, "certificate": PURPLE}  # colour of each arrow
SLACK_N = 1e-9
# Half of the edge of the plane of a certificate, as a share of the arrow of the strongest tension.
PLANE_SHARE = 0.7


@dataclass(frozen=True)
class Lines:
    """Line segments (k, 2, 3), in m, and their colours (k, 3)."""

    points: Floats
    colours: Colours


@dataclass(frozen=True)
class Arrow:
    """Arrow from a place to another, (3,), in m."""

    start: Floats
    end: Floats


@dataclass(frozen=True, eq=False)
class RigScene:
    """A rig with its tensions and forces, as it is drawn while it is designed and while it runs.

    Attributes
    ----------
    cables, platform : Lines
        Cables by tension, and arms of the platform.
    anchors, colours : (m, 3) arrays
        Where the modules are, in m, and their colours.
    hand : (3,) array
        The point, or the platform's reference point, in m.
    labels : tuple of str
        Name and tension of each module.
    arrows : dict of str to Arrow
        Forces by name.
    """

    cables: Lines
    platform: Lines
    anchors: Floats
    colours: Colours
    hand: Floats
    labels: tuple[str, ...]
    arrows: dict[str, Arrow]


@dataclass(frozen=True, eq=False)
class DesignScene:
    """All that is drawn of a state except the workspace.

    Attributes
    ----------
    rig : RigScene
        The rig, with arrows of `ARROWS`.
    tip : (3,) array
        Where the arrow of the desired force is grabbed.
    ghost, walls, edges : Lines
        The other rig, the surfaces of the space, and the edges of the available forces.
    available : Mesh or None
        Forces that are available at the hand.
    plane : Mesh or None
        Plane beyond which the desired force is certified to be.
    """

    rig: RigScene
    tip: Floats
    ghost: Lines
    walls: Lines
    edges: Lines
    available: Mesh | None
    plane: Mesh | None


def draw(state: DesignState, found: StateEvaluation) -> DesignScene:
    """Return what is drawn of a state and its evaluation."""
    anchors, ends, hand = (in_space(points) for points in (state.anchors, state.attachments, state.position))
    scale = force_scale(state.rig)
    force = in_space(state.wrench[: state.rig.dimension])
    available, edges = _available(found, hand, scale)
    arrows = _arrows(state, found, hand, scale)
    certificate = _certificate(state, found, hand, scale)
    if certificate is not None:
        arrows["certificate"] = certificate[0]
    rig = RigScene(
        cables=cable_lines(_cable_points(state), tension_colours(state.rig, found)),
        platform=platform_lines(hand, ends),
        anchors=anchors,
        colours=module_colours(state.rig),
        hand=hand,
        labels=_labels(state, found),
        arrows=arrows,
    )
    plane = None if certificate is None else certificate[1]
    tip = _tip(hand, scale * force, size(state.rig))
    return DesignScene(rig, tip, _ghost(state), _walls(state), edges, available, plane)


def _tip(hand: Floats, force: Floats, reach: float) -> Floats:
    """Return where the arrow of the desired force is grabbed: at its end, or near the hand if it is short."""
    if float(np.linalg.norm(force)) >= TIP_SHARE * reach:
        return np.asarray(hand + force)
    return np.asarray(hand + TIP_SHARE * reach * np.array([0.8, 0.6, 0.0]))


def size(rig: Rig) -> float:
    """Return the longest edge of the box around a rig, in m."""
    low, high = bounds(rig)
    return float((high - low).max())


def force_scale(rig: Rig) -> float:
    """Return the length in m that is drawn for 1 N: a round number that suits the rig's size and tensions."""
    wanted = FORCE_SHARE * size(rig) / max(float(rig.limits.upper.max()), SLACK_N)
    power = 10.0 ** math.floor(math.log10(wanted))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1 + 1e-12))


def tension_colours(rig: Rig, found: StateEvaluation) -> Colours:
    """Return the colour of each cable, (m, 3), by where its tension is between its limits; grey without one."""
    tensions = np.full(rig.m, np.nan) if found.allocation is None else found.allocation.tensions
    return ramp(tensions, rig.limits.lower, rig.limits.upper)


def module_colours(rig: Rig) -> Colours:
    """Return the colour of each module, (m, 3), which tells those on bodies from those in the world."""
    bodies = np.array([module.frame in rig.frames for module in rig.modules])
    return np.where(bodies[:, None], rgb(ORANGE), rgb(BLUE))


def cable_lines(points: Floats, colours: Colours) -> Lines:
    """Return the lines of cables through points (k, m, 3) from their attachments on, with colours (m, 3)."""
    pieces = np.stack([points[:-1], points[1:]], axis=2).reshape(-1, 2, 3)
    return Lines(pieces, np.tile(colours, (len(points) - 1, 1)))


def _cable_points(state: DesignState) -> Floats:
    return in_space(ways(state.attachments, state.anchors, state.rig.pulleys_in_world(state.rig.at_rest)))


def plain_lines(points: Floats, colour: str) -> Lines:
    """Return lines (k, 2, 3) of one colour."""
    return Lines(points, np.tile(rgb(colour), (len(points), 1)))


NO_LINES = plain_lines(np.empty((0, 2, 3)), GREY)


def platform_lines(hand: Floats, ends: Floats) -> Lines:
    """Return lines from the reference point to the attachments; none for a point."""
    apart = ends[np.linalg.norm(ends - hand, axis=1) > 0.0]
    return plain_lines(np.stack([np.broadcast_to(hand, apart.shape), apart], axis=1), GREY)


def _ghost(state: DesignState) -> Lines:
    """Return the cables of the other rig, from its anchors to the same hand."""
    other = ghost_state(state)
    return NO_LINES if other is None else cable_lines(_cable_points(other), np.tile(rgb(GREY), (other.rig.m, 1)))


def _walls(state: DesignState) -> Lines:
    """Return the edges of the surfaces to which anchors snap."""
    return NO_LINES if state.task is None else plain_lines(in_space(outlines(state.task.space)), GREY)


def _labels(state: DesignState, found: StateEvaluation) -> tuple[str, ...]:
    names = tuple(module.name for module in state.rig.modules)
    if found.allocation is None:
        return names
    return tuple(
        f"{name} · {format_number(tension)} N"
        for name, tension in zip(names, found.allocation.tensions, strict=True)
    )


def _arrows(state: DesignState, found: StateEvaluation, hand: Floats, scale: float) -> dict[str, Arrow]:
    """Return the desired force, and where it is not rendered, the rendered one and the error."""
    d = state.rig.dimension
    desired = hand + scale * in_space(state.wrench[:d])
    arrows = {"desired": Arrow(hand, desired)}
    if found.allocation is not None and found.rendered is not None and found.allocation.status != Status.EXACT:
        rendered = hand + scale * in_space(found.rendered[:d])
        if np.isfinite(rendered).all():
            arrows |= {"rendered": Arrow(hand, rendered), "error": Arrow(rendered, desired)}
    return arrows


def _available(found: StateEvaluation, hand: Floats, scale: float) -> tuple[Mesh | None, Lines]:
    """Return the faces and edges of the available forces, to scale around the hand."""
    if found.available is None:
        return None, NO_LINES
    corners = hand + scale * in_space(found.available.corners)
    return Mesh(corners, found.available.faces), plain_lines(corners[found.available.edges], BLUE)


def _certificate(
    state: DesignState, found: StateEvaluation, hand: Floats, scale: float
) -> tuple[Arrow, Mesh] | None:
    """Return the direction that certifies the desired force infeasible, and the plane across it.

    The plane touches the set of available forces, and the desired force is beyond it.
    """
    certificate = found.certificate
    if certificate is None:
        return None
    along, d = in_space(certificate.direction), state.rig.dimension
    foot = hand + scale * (in_space(state.wrench[:d]) + (certificate.reach - certificate.desired) * along)
    reach = PLANE_SHARE * scale * float(state.rig.limits.upper.max())
    across = reach * np.linalg.svd(along[None])[2][1:]
    if d == 2:  # from the front it shows as a line
        across = reach * np.stack([np.cross(along, [0.0, 0.0, 1.0]), 0.03 * along])
    ring = foot + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ across
    start = foot + across[0]  # at the edge, clear of the other arrows
    return Arrow(start, start + reach * along), Mesh(ring, np.array([[0, 1, 2], [0, 2, 3]]))
