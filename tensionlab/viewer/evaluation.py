"""Tensions, capacity margin and available forces of a state, from the public interface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Allocation, Allocator
from tensionlab.errors import TensionlabError
from tensionlab.solvers.base import Policy, Status
from tensionlab.support.arrays import Floats
from tensionlab.viewer.state import DesignState
from tensionlab.workspace.margin import required_margin
from tensionlab.workspace.wrench_set import HalfSpaces, half_spaces, vertices

FLAT = 1e-9  # share of the largest force that counts as none
COPLANAR = 1e-6  # largest difference of the equations of faces in one plane


@dataclass(frozen=True)
class ForceSet:
    """Forces that are available at the hand in addition to what the rig requires, as a polytope."""

    corners: Floats  # (k, d), in N
    faces: NDArray[np.int64]  # triangles (f, 3), anticlockwise from outside; in the plane they fill the polygon
    edges: NDArray[np.int64]  # (e, 2)


@dataclass(frozen=True)
class Certificate:
    """Proof that a force is infeasible: along a direction, available forces reach less far than it."""

    direction: Floats  # unit vector of force, (d,)
    reach: float  # at least the largest ``direction @ force`` available at the desired torque, in N
    desired: float  # ``direction @ force`` of the desired force, in N, which is larger


@dataclass(frozen=True)
class StateEvaluation:
    """Answers for one state."""

    allocation: Allocation | None  # for the desired and the required wrench; None where `problem` says why
    policy: Policy | None  # that the solver honours where the wrench is infeasible
    margin: float  # capacity margin at the hand about what the rig requires, in N; NaN if a cable has no length
    available: ForceSet | None = None  # at the desired torque; None if there are none
    rendered: Floats | None = None  # wrench in addition to what the rig requires, (n,), in N and N·m
    certificate: Certificate | None = None  # that the desired force is infeasible; None without one
    problem: str = ""  # why there is no allocation


def evaluate(state: DesignState) -> StateEvaluation:
    """Return the tensions, the margin and the available forces of a state."""
    rig = state.rig
    try:
        structure = rig.structure_matrix(state.position, state.rotation, rig.at_rest)
        required = rig.required.middle(rig, state.rotation)
        margin = float(required_margin(rig, structure, rig.required, state.rotation))
    except TensionlabError as error:
        return StateEvaluation(None, None, float("nan"), problem=str(error))
    available = force_set(structure, state, required)
    try:
        allocator = Allocator(rig.limits, state.solver, policy=state.policy)
        allocation = allocator(structure, state.wrench + required)
    except TensionlabError as error:
        return StateEvaluation(None, None, margin, available, problem=str(error))
    return StateEvaluation(
        allocation,
        allocator.policy,
        margin,
        available,
        allocation.wrench - required,
        _certificate(structure, state, required, allocation),
    )


def _certificate(
    structure: Floats, state: DesignState, required: Floats, allocation: Allocation
) -> Certificate | None:
    """Return what the separating direction of the wrench says of its force, at the desired torque."""
    d, direction = state.rig.dimension, allocation.separation
    length = float(np.linalg.norm(direction[:d]))
    if allocation.status != Status.NEAREST or length <= FLAT * float(np.linalg.norm(direction)):
        return None
    pulls = direction @ structure
    limits = state.rig.limits
    reach = float(np.maximum(pulls * limits.lower, pulls * limits.upper).sum())
    reach -= float(direction @ required) + float(direction[d:] @ state.wrench[d:])
    along = direction[:d] / length
    return Certificate(along, reach / length, float(along @ state.wrench[:d]))


def force_set(structure: Floats, state: DesignState, required: Floats) -> ForceSet | None:
    """Return the forces that are available at the desired torque; None if no tensions exert that torque."""
    rig = state.rig
    d = rig.dimension
    if rig.n == d:
        return polytope(vertices(structure, rig.limits) - required)
    corners = _section(half_spaces(structure, rig.limits), (state.wrench + required)[d:], d)
    return None if corners is None else polytope(corners - required[:d])


def _section(spaces: HalfSpaces, torque: Floats, d: int) -> Floats | None:
    """Return the corners (k, d) of the available wrenches with that torque; None where there is no volume of them.

    The planes are those of the wrenches, cut at the torque. Their corners are found around a point inside, the
    middle of the largest ball.
    """
    from scipy.optimize import linprog
    from scipy.spatial import HalfspaceIntersection, QhullError

    normals, offsets = spaces.normals[:, :d], spaces.offsets - spaces.normals[:, d:] @ torque
    length = np.linalg.norm(normals, axis=1)
    steep = length > FLAT
    if (offsets[~steep] < 0.0).any():
        return None
    normals, offsets, length = normals[steep], offsets[steep], length[steep]
    rows = np.column_stack([normals, length])
    bounds = [(None, None)] * d + [(0.0, None)]
    ball = linprog(np.append(np.zeros(d), -1.0), A_ub=rows, b_ub=offsets, bounds=bounds, method="highs")
    if ball.x is None or ball.x[-1] <= FLAT * np.abs(offsets).max(initial=1.0):
        return None
    try:
        planes = HalfspaceIntersection(np.column_stack([normals, -offsets]), ball.x[:-1])
    except QhullError:
        return None
    return np.asarray(planes.intersections[np.isfinite(planes.intersections).all(axis=1)])


def polytope(points: Floats) -> ForceSet | None:
    """Return the hull of points (k, d), with triangles and edges; None for a set without a volume."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    if points.shape[1] == 2:
        ring = hull.vertices  # anticlockwise
        count = len(ring)
        fan = np.array([[0, i, i + 1] for i in range(1, count - 1)])
        return ForceSet(points[ring], fan, np.column_stack([np.arange(count), np.roll(np.arange(count), -1)]))
    number = np.full(len(points), -1)
    number[hull.vertices] = np.arange(len(hull.vertices))
    corners = points[hull.vertices]
    faces = number[hull.simplices]
    across = np.cross(corners[faces[:, 1]] - corners[faces[:, 0]], corners[faces[:, 2]] - corners[faces[:, 0]])
    inward = np.einsum("ij,ij->i", across, hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    edges = []  # where triangles meet that are not in one plane
    for side in range(3):  # a neighbour is opposite the corner of its number
        other = hull.neighbors[:, side]
        bent = np.abs(hull.equations - hull.equations[other]).max(axis=1) > COPLANAR
        edges.append(np.delete(hull.simplices, side, axis=1)[bent & (np.arange(len(other)) < other)])
    return ForceSet(corners, faces, number[np.concatenate(edges)])
