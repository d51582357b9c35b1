"""Clearance of the cables of a layout from bodies, over the whole of a target.

The cables from an anchor to all positions of a convex target fill the convex hull of both, and bodies are convex,
too. So the least distance of these cables from a body is that of two convex sets, and a plane between the sets
proves it for all positions at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from tensionlab.errors import RigError
from tensionlab.model.bodies import HAND, Body, place_bodies
from tensionlab.model.pose import Frames
from tensionlab.support.arrays import Floats, Integers
from tensionlab.workspace.layout.objective import Target
from tensionlab.workspace.poses import PoseList

PATH_PIECES = 32  # boxes that cover a path of the hand, if it has more positions
GAP_M = 1e-5  # error of a distance, at most
MAX_STEPS = 2000  # of a search for a distance; 10 to 100 are usual


class Obstacles(NamedTuple):
    """Bodies and targets: what the cables to a target must stay clear of."""

    names: tuple[str, ...]  # of the b bodies
    pieces: Floats  # convex pieces of the targets, (T, V, d)
    vertices: Floats  # of the bodies, (b, B, d)
    reach: Floats  # of each body beyond its vertices, (b,) in m
    margin: Floats  # that cables must keep beyond that, (b,) in m
    held: Integers  # whether each body moves with the hand, (b,)

    @classmethod
    def of(cls, bodies: Sequence[Body], targets: Sequence[Target], frames: Frames) -> Obstacles:
        """Return the obstacles of bodies, whose frames have these poses, to the cables in targets."""
        d = targets[0].dimension
        placed = place_bodies(bodies, np.zeros(d), None, frames)
        signs = np.array(list(product((-0.5, 0.5), repeat=d)))
        corners = [
            ends if body.size is None or axes is None else ends[0] + (signs * body.size) @ axes.T
            for body, (ends, axes) in zip(bodies, placed, strict=True)
        ]
        return cls(
            tuple(body.name for body in bodies),
            np.concatenate([_pieces(target, 2**d) for target in targets]),
            np.stack([np.resize(vertices, (max(map(len, corners)), d)) for vertices in corners]),
            np.array([body.radius + body.sway for body in bodies]),
            np.array([body.margin for body in bodies]),
            np.array([body.frame == HAND for body in bodies]),
        )

    def slopes(self, anchors: Floats, ample: float = np.inf) -> tuple[Floats, Floats]:
        """Return the distance (..., b) of cables to anchors (..., d) from bodies, and its slopes (..., b, d).

        The distance is a lower bound, within `GAP_M` up to ``ample`` beyond the margin. It is below zero where a
        cable comes closer to the segment of a capsule than the radius.
        """
        flat = anchors.reshape(-1, anchors.shape[-1])
        hulls, has_anchor = self._hulls(flat)
        enough = np.broadcast_to((self.reach + self.margin + ample)[:, None], hulls.shape[:3])
        distance, normal, weights = separate(hulls.reshape(-1, *hulls.shape[3:]), enough.ravel())
        distances = distance.reshape(hulls.shape[:3])
        pick = np.ravel_multi_index(
            (*np.indices(distances.shape[:2]), distances.argmin(axis=-1)), distances.shape
        )  # the piece of the targets that is nearest
        share = np.einsum("nbv,bv->nb", weights[pick], has_anchor)
        slopes = share[..., None] * normal[pick]
        shape = (*anchors.shape[:-1], len(self.names))
        return (distances.min(axis=-1) - self.reach).reshape(shape), slopes.reshape(*shape, -1)

    def require_clear(self, anchors: Floats, names: Sequence[str]) -> None:
        """Refuse targets, and fixed modules at anchors (f, d), that are closer to a body than its margin."""
        points = np.where(self.held[:, None, None, None], 0.0, self.pieces)
        hand = points[..., None, :] - self.vertices[:, None, None]
        hulls = hand.reshape(-1, hand.shape[2] * hand.shape[3], hand.shape[4])
        near = separate(hulls, np.full(len(hulls), np.inf))[0].reshape(len(self.names), -1).min(axis=-1)
        for what, distances in [("target: the hand", near - self.reach)] + [
            (f'module "{name}": its cable', distance)
            for name, distance in zip(names, self.slopes(anchors)[0] if len(anchors) else (), strict=True)
        ]:
            body = int(np.argmin(distances - self.margin))
            if distances[body] < self.margin[body]:
                raise RigError(
                    f'{what} is as close as {distances[body]:.3f} m to body "{self.names[body]}", whose margin is '
                    f"{self.margin[body]:g} m; move one of them, or give the body a smaller margin"
                )

    def _hulls(self, anchors: Floats) -> tuple[Floats, Floats]:
        """Return the vertices (N, b, T, V, d) of cables minus bodies, and 1 (b, V) for those with the anchor."""
        (_, count, d), (bodies, corners, _) = self.pieces.shape, self.vertices.shape
        pieces = np.broadcast_to(self.pieces, (len(anchors), *self.pieces.shape))
        here = np.broadcast_to(anchors[:, None, None], (*pieces.shape[:2], 1, d))
        fixed, moving = np.concatenate([here, pieces], axis=2), np.concatenate([0.0 * here, here - pieces], axis=2)
        cables = np.where(self.held[:, None, None, None], moving[:, None], fixed[:, None])
        hulls = cables[..., None, :] - self.vertices[:, None, None]
        first = np.arange(1 + count) == 0
        has_anchor = np.where(self.held[:, None], ~first, first).repeat(corners, axis=-1).astype(float)
        return hulls.reshape(len(anchors), bodies, -1, (1 + count) * corners, d), has_anchor


def separate(hulls: Floats, enough: Floats) -> tuple[Floats, Floats, Floats]:
    """Return distances (N,) of hulls of vertices (N, V, d) from the origin, normals (N, d) and weights (N, V).

    The distance is a lower bound, which the plane with the normal proves; the weights make up the nearest point.

    Weight is moved from the farthest vertex to the nearest along the point that they make up, until the plane
    through that point proves its distance up to `GAP_M`, or more than ``enough`` (N,).

    Source: Mitchell, Demyanov and Malozemov, "Finding the point of a polyhedron closest to the origin", 1974.
    """
    count = np.arange(len(hulls))
    nearest = np.square(hulls).sum(axis=-1).argmin(axis=-1)
    weights = np.zeros(hulls.shape[:2])
    weights[count, nearest] = 1.0
    distance, normal = np.zeros(len(hulls)), np.zeros((len(hulls), hulls.shape[-1]))
    todo = count
    for _ in range(MAX_STEPS):
        own, part = hulls[todo], weights[todo]
        point = np.einsum("nv,nvd->nd", part, own)
        length = np.linalg.norm(point, axis=-1)
        unit = point / np.where(length > 0.0, length, 1.0)[:, None]
        along = np.einsum("nvd,nd->nv", own, unit)
        best, worst = along.argmin(axis=-1), np.where(part > 0.0, along, -np.inf).argmax(axis=-1)
        row = np.arange(len(todo))
        proved = along[row, best].clip(min=0.0)
        better = proved >= distance[todo]
        distance[todo[better]], normal[todo[better]] = proved[better], unit[better]
        undecided = (length - proved > GAP_M) & (proved < enough[todo])
        change = own[row, worst] - own[row, best]
        step = length * (along[row, worst] - along[row, best]) / np.maximum(np.square(change).sum(axis=-1), 1e-300)
        step = np.where(undecided, np.minimum(step, part[row, worst]), 0.0)
        part[row, worst] -= step
        part[row, best] += step
        weights[todo] = part
        todo = todo[undecided]
        if not len(todo):
            break
    return distance, normal, weights


def _pieces(target: Target, count: int) -> Floats:
    """Return convex pieces (T, count, d) that cover a target: the box of a grid, or boxes along a path."""
    points = target.arrays()[0]
    parts = [points]
    if isinstance(target, PoseList):
        ends = np.linspace(0, max(len(points) - 1, 1), min(max(len(points) - 1, 1), PATH_PIECES) + 1).round()
        parts = [points[int(a) : int(b) + 1] for a, b in pairwise(ends)]
    if max(map(len, parts)) <= count:
        return np.stack([np.resize(part, (count, points.shape[1])) for part in parts])
    return np.stack([list(product(*zip(part.min(axis=0), part.max(axis=0), strict=True))) for part in parts])
