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
from tensionlab.workspace.wrench_set import half_spaces, required_margin, vertices

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
    policy: Policy | None  # that the solver supports where the wrench is infeasible
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
    rendered, certificate = allocation.wrench - required, _certificate(structure, state, required, allocation)
    return StateEvaluation(allocation, allocator.policy, margin, available, rendered, certificate)


def _certificate(
    structure: Floats, state: DesignState, required: Floats, allocation: Allocation
) -> Certificate | None:
    """Return the bound that the separating direction of the wrench puts on the force, at the desired torque."""
    d, direction, limits = state.rig.dimension, allocation.separation, state.rig.limits
    length = float(np.linalg.norm(direction[:d]))
    if allocation.status != Status.NEAREST or length <= FLAT * float(np.linalg.norm(direction)):
        return None
    pulls = direction @ structure
    reach = float(np.maximum(pulls * limits.lower, pulls * limits.upper).sum())
    reach -= float(direction @ required) + float(direction[d:] @ state.wrench[d:])
    along = direction[:d] / length
    return Certificate(along, reach / length, float(along @ state.wrench[:d]))


def force_set(structure: Floats, state: DesignState, required: Floats) -> ForceSet | None:
    """Return the forces that are available at the desired torque; None if no volume of them is."""
    from scipy.optimize import linprog
    from scipy.spatial import HalfspaceIntersection, QhullError

    rig, d = state.rig, state.rig.dimension
    if rig.n == d:
        return polytope(vertices(structure, rig.limits) - required)
    # The planes of the available wrenches, cut at the torque, meet around the middle of the largest ball inside.
    spaces = half_spaces(structure, rig.limits)
    normals, offsets = (
        spaces.normals[:, :d],
        spaces.offsets - spaces.normals[:, d:] @ (state.wrench + required)[d:],
    )
    length = np.linalg.norm(normals, axis=1)
    steep = length > FLAT
    if (offsets[~steep] < 0.0).any():
        return None
    normals, offsets, length = normals[steep], offsets[steep], length[steep]
    bounds = [(None, None)] * d + [(0.0, None)]
    ball = linprog([0.0] * d + [-1.0], np.column_stack([normals, length]), offsets, bounds=bounds).x
    if ball is None or ball[-1] <= FLAT * np.abs(offsets).max(initial=1.0):
        return None
    try:
        corners = HalfspaceIntersection(np.column_stack([normals, -offsets]), ball[:-1]).intersections
    except QhullError:
        return None
    return polytope(corners[np.isfinite(corners).all(axis=1)] - required[:d])


def polytope(points: Floats) -> ForceSet | None:
    """Return the hull of points (k, d), with triangles and edges; None for a set without a volume."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    if points.shape[1] == 2:
        ring = np.arange(len(hull.vertices))  # anticlockwise
        fan = np.column_stack([0 * ring[2:], ring[1:-1], ring[2:]])
        return ForceSet(points[hull.vertices], fan, np.column_stack([ring, np.roll(ring, -1)]))
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
