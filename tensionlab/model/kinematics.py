"""Kinematics of straight cables, forward and inverse, for arrays of poses: arrays in, arrays out.

Conventions. d is the dimension of space (2 or 3), m the number of cables; every function broadcasts over leading
axes. The unit vector u of a cable points from its attachment to its anchor; its arm r runs from the platform's
reference point to the attachment, in world axes. A twist is (velocity of the reference point, angular velocity in
world axes). The structure matrix W has the columns ``[u; r x u]``: ``W t`` is the wrench of the tensions t on the
platform, and ``W = -J'`` with J the derivative of the cable lengths with respect to the twist (Verhoeven 2004,
"Analysis of the workspace of tendon-based Stewart platforms"; Pott 2018, "Cable-Driven Parallel Robots", chapter
3). Cables are massless and stiff, straight from a fixed anchor or from a pulley (`tensionlab.model.pulleys`).

Nothing is validated here; `tensionlab.model.rig.Rig` does that, because it knows the names.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.model.pulleys import Pulleys, route_cables, turn_gradient
from tensionlab.support.arrays import Floats, Integers, common_axes


def planar_rotation(angle: Floats) -> Floats:
    """Return the matrices, (..., 2, 2), that turn the plane anticlockwise by angles, (...), in rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def exponential(vector: Floats) -> Floats:
    """Return the rotations, (..., 3, 3), about axes by angles, given as axis times angle, (..., 3), in rad.

    Rodrigues' formula, ``1 + sin(a)/a K + (1 - cos(a))/a² K²`` with K the cross-product matrix of the vector and a
    its length, by sinc.
    """
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    half = np.sinc(angle / (2 * np.pi))  # numpy's sinc(x) is sin(pi x)/(pi x)
    turn: Floats = np.eye(3) + np.sinc(angle / np.pi) * K + half**2 / 2 * (K @ K)
    return turn


def in_space(points: Floats) -> Floats:
    """Return points (..., d) in space, (..., 3): those in the plane have z = 0."""
    missing = 3 - points.shape[-1]
    return np.concatenate([points, np.zeros((*points.shape[:-1], missing))], axis=-1)


def turn_axes(old_axis: Floats, new_axis: Floats) -> Floats:
    """Return the rotation (d, d) that turns one axis, a signed unit vector (d,), to another.

    The axes take each other's places in turn (x y z, y z x), two with a minus where signs differ.
    """
    old, new = int(np.abs(old_axis).argmax()), int(np.abs(new_axis).argmax())
    rotation = np.roll(np.eye(new_axis.size), new - old, axis=0)
    rotation[new] *= old_axis[old] * new_axis[new]
    if np.linalg.det(rotation) < 0.0:
        rotation[(new + 1) % new_axis.size] *= -1.0
    return rotation


def fit_rotation(source: Floats, target: Floats) -> Floats:
    """Return the rotation (d, d) that turns vectors (K, d) closest to others, without mirroring.

    Kabsch 1976, Acta Crystallographica A32; Wahba's problem.
    """
    u, _, vt = np.linalg.svd(target.T @ source)
    signs = np.ones(len(u))
    signs[-1] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    return np.asarray(u @ np.diag(signs) @ vt, dtype=np.float64)


def rotate(rotation: Floats, points: Floats) -> Floats:
    """Rotate points, (m, d), by each of the matrices, (..., d, d)."""
    turned: Floats = points @ np.swapaxes(rotation, -1, -2)
    return turned


def cables(
    anchors: Floats, position: Floats, arms: Floats | None, pulleys: Pulleys | None = None
) -> tuple[Floats, Floats]:
    """Return lengths (..., m), in m, and directions (..., m, d), zeros for a cable of no length.

    From anchors (..., m, d), the position (..., d) of the reference point, and arms (..., m, d), None where all
    attach at the point; in world axes, in m. Of a cable over a pulley, the length is that from the anchor.
    """
    vectors = to_anchors(anchors, position, arms)
    if pulleys is not None:
        lengths, directions, _ = route_cables(vectors, pulleys)
        return lengths, directions
    lengths = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return lengths, vectors / (lengths if lengths.all() else np.where(lengths > 0.0, lengths, 1.0))[..., None]


def to_anchors(anchors: Floats, position: Floats, arms: Floats | None) -> Floats:
    """Return the vectors (..., m, d) from attachments to anchors; arguments as in `cables`."""
    vectors: Floats = anchors - position[..., None, :]
    return vectors if arms is None else vectors - arms


def structure_matrix(directions: Floats, arms: Floats | None) -> Floats:
    """Return the structure matrices (..., n, m) of directions and arms, (..., m, d).

    n = d for a point, which has no arms and no torque; 3 for a planar platform (torque about z), 6 in space.
    """
    u = np.swapaxes(directions, -1, -2)
    if arms is None:
        return u.copy()
    r = np.swapaxes(arms, -1, -2)
    d, m = u.shape[-2:]
    W = np.empty((*np.broadcast_shapes(u.shape[:-2], r.shape[:-2]), 3 * (d - 1), m))
    W[..., :d, :] = u
    pairs = [(0, 1)] if d == 2 else [(1, 2), (2, 0), (0, 1)]
    for row, (i, j) in enumerate(pairs, start=d):
        W[..., row, :] = r[..., i, :] * u[..., j, :] - r[..., j, :] * u[..., i, :]
    return W


def anchor_gradient(
    gradient: Floats, vectors: Floats, arms: Floats | None, pulleys: Pulleys | None = None
) -> Floats:
    """Return the derivative of a number with respect to the anchors, from that with respect to W.

    A column changes by ``[du; r x du]``, and u by what of the anchor's motion is across the cable, over its
    length. Moving the reference point without a turn changes the same number by the opposite of all anchors
    together. From (..., n, m), and vectors (..., m, d) to the anchors, to (..., m, d), in world axes, per m.
    """
    d = vectors.shape[-1]
    columns = np.swapaxes(gradient, -1, -2)
    pull = columns[..., :d]
    if arms is not None:  # torque . (r x du) = du . (torque x r)
        torque = columns[..., d:]
        if d == 2:
            pull = pull + torque * np.stack([-arms[..., 1], arms[..., 0]], axis=-1)
        else:
            pull = pull + np.cross(torque, arms)
    return direction_gradient(pull, vectors, pulleys)


def direction_gradient(pull: Floats, vectors: Floats, pulleys: Pulleys | None = None) -> Floats:
    """Return the derivative of a number with respect to the anchors, from that with respect to the directions.

    Both are (..., m, d); vectors and pulleys as in `anchor_gradient`.
    """
    if pulleys is not None:
        return turn_gradient(pull, vectors, pulleys)
    squares = np.einsum("...i,...i->...", vectors, vectors)[..., None]
    along = np.einsum("...i,...i->...", pull, vectors)[..., None]
    across: Floats = (pull - along / squares * vectors) / np.sqrt(squares)
    return across


def attachment_gradient(gradient: Floats, directions: Floats, by_anchor: Floats) -> Floats:
    """Return the derivative of a number with respect to the arms, from those by W and by the anchors.

    A cable turns as if its anchor moved the other way, and its torque changes by ``dr x u``. From (..., n, m),
    unit vectors (..., m, d) and `anchor_gradient` to (..., m, d), in world axes, per m.
    """
    d, u = directions.shape[-1], directions
    torque = np.swapaxes(gradient, -1, -2)[..., d:]  # torque . (dr x u) = dr . (u x torque)
    turned = torque * np.stack([u[..., 1], -u[..., 0]], axis=-1) if d == 2 else np.cross(u, torque)
    return turned - by_anchor


# A pose is found when the next step would change the lengths by less than this share of the longest.
STEP_TOLERANCE = 1e-13

ITERATION_LIMIT = 100
FIRST_DAMPING, MAX_DAMPING = 1e-3, 1e10
RIDGE = 1e-9


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """Pose found from cable lengths, and how well it explains them.

    Attributes
    ----------
    position : (..., d) array
        Position of the reference point, in m.
    rotation : (..., 3, 3) array, (...) array or None
        Orientation: a matrix in space, an angle in (-pi, pi] in the plane, None for a point.
    residual : (...) array
        Root mean square of the length errors, in m. If it is large, no pose near the guess has these lengths.
    iterations : (...) array
        Number of steps tried.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> lengths = rig.lengths([0.1, 0.4, 0.2])
    >>> estimate = rig.forward_kinematics(lengths)
    >>> estimate.position.round(6)
    array([0.1, 0.4, 0.2])
    >>> bool(estimate.residual < 1e-9)  # m: the lengths fit together
    True
    """

    position: Floats
    rotation: Floats | None
    residual: Floats
    iterations: Integers


def estimate_pose(
    anchors: Floats,
    attachments: Floats | None,
    lengths: Floats,
    position: Floats,
    rotation: Floats | None,
    pulleys: Pulleys | None = None,
) -> PoseEstimate:
    """Find poses as `solve_pose` does, for arrays that broadcast."""
    m, d = anchors.shape[-2:]
    turn = np.eye(d) if rotation is None else rotation
    shapes = {"lengths": lengths.shape[:-1], "position": position.shape[:-1], "rotation": turn.shape[:-2]}
    batch = common_axes({**shapes, "frames": anchors.shape[:-2]})
    if pulleys is not None and pulleys.axes.ndim > 2:
        pulleys = Pulleys(pulleys.radii, np.broadcast_to(pulleys.axes, (*batch, m, d)).reshape(-1, m, d))
    p, R, residual, iterations = solve_pose(
        np.broadcast_to(anchors, (*batch, m, d)).reshape(-1, m, d),
        attachments,
        np.broadcast_to(lengths, (*batch, m)).reshape(-1, m),
        np.broadcast_to(position, (*batch, d)).reshape(-1, d),
        None if attachments is None else np.broadcast_to(turn, (*batch, d, d)).reshape(-1, d, d),
        pulleys,
    )
    if R is None:
        orientation = None
    elif d == 2:
        orientation = np.arctan2(R[:, 1, 0], R[:, 0, 0]).reshape(batch)
    else:
        orientation = R.reshape(*batch, d, d)
    return PoseEstimate(p.reshape(*batch, d), orientation, residual.reshape(batch), iterations.reshape(batch))


def solve_pose(
    anchors: Floats,
    attachments: Floats | None,
    lengths: Floats,
    position: Floats,
    rotation: Floats | None,
    pulleys: Pulleys | None = None,
) -> tuple[Floats, Floats | None, Floats, Integers]:
    """Find the poses near the guesses that fit the cable lengths best, in the least-squares sense.

    Levenberg-Marquardt (Marquardt 1963) on the twist: the derivative of the lengths is ``J = -W'`` in closed
    form, the damping is scaled by the diagonal of ``J'J`` so that metres and radians need no common unit,
    and a step turns the platform by the exponential map. A pose that has been found leaves the batch.

    Anchors are (B, m, d), attachments (m, d) in platform axes, lengths (B, m), and guesses (B, d) and (B, d, d);
    axes of pulleys (m, d) or (B, m, d). A point has no attachments and no rotation. Returns what `PoseEstimate`
    has, with rotations as matrices.
    """
    position = position.copy()
    rotation = None if rotation is None else rotation.copy()
    batch, d = position.shape
    residual = np.zeros(batch)
    iterations: NDArray[np.int64] = np.zeros(batch, dtype=np.int64)
    damping = np.full(batch, FIRST_DAMPING)
    active = np.arange(batch)

    while active.size:
        A, L, p = anchors[active], lengths[active], position[active]
        R = None if rotation is None else rotation[active]
        over = None if pulleys is None else pulleys.rows(active)
        error, W = _errors(A, attachments, L, p, R, over)
        cost = np.mean(error**2, axis=-1)
        residual[active] = np.sqrt(cost)

        # The lengths fall short by `error` and change by J twist = -W' twist: J'J = WW', and J'error = -W error.
        normal = W @ np.swapaxes(W, -1, -2)
        diagonal = np.einsum("...ii->...i", normal)
        scale = diagonal + RIDGE * diagonal.max(axis=-1, keepdims=True)
        damped = normal + (damping[active, None] * scale)[..., None] * np.eye(W.shape[-2])
        step = -np.linalg.solve(damped, W @ error[..., None])[..., 0]
        predicted = np.sqrt(np.mean(np.einsum("...nm,...n->...m", W, step) ** 2, axis=-1))

        trial_p, trial_R = p + step[:, :d], None
        if R is not None:
            trial_R = (planar_rotation(step[:, d]) if d == 2 else exponential(step[:, d:])) @ R
        trial_cost = np.mean(_errors(A, attachments, L, trial_p, trial_R, over)[0] ** 2, axis=-1)
        better = trial_cost < cost
        position[active[better]] = trial_p[better]
        if rotation is not None and trial_R is not None:
            rotation[active[better]] = trial_R[better]
        residual[active[better]] = np.sqrt(trial_cost[better])
        damping[active] = np.where(better, np.maximum(damping[active] / 30, 1e-15), damping[active] * 10)
        iterations[active] += 1

        converged = predicted <= STEP_TOLERANCE * L.max(axis=-1)
        stopped = (damping[active] > MAX_DAMPING) | (iterations[active] >= ITERATION_LIMIT)
        active = active[~(converged | stopped)]

    return position, rotation, residual, iterations


def _errors(
    A: Floats, b: Floats | None, L: Floats, p: Floats, R: Floats | None, over: Pulleys | None
) -> tuple[Floats, Floats]:
    """Measured minus modelled lengths, and the structure matrices."""
    arms = None if b is None or R is None else rotate(R, b)
    lengths, directions = cables(A, p, arms, over)
    return L - lengths, structure_matrix(directions, arms)
