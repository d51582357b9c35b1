"""Calibration of the anchors of a rig from the lengths of its cables.

At known poses each anchor is where the lengths of its cable meet (multilateration). At unknown ones a rig with
more cables than degrees of freedom calibrates itself: each pose brings m lengths and n unknowns, and the remaining
equations determine the anchors. See Borgstrom et al. 2009, "NIMS-PL: A Cable-Driven Robot With Self-Calibration
Capabilities", IEEE Transactions on Robotics 25(5); Jin et al. 2018, Sensors 18(7); and Hangprinter's
auto-calibration. Lengths show neither where the rig stands, its orientation nor which of its mirror images it is:
that is taken from the nominal rig. Nor do they show an error of all lengths in the same proportion.

Poses are eliminated (variable projection, Golub and Pereyra 1973, in Kaufman's approximation): for given anchors
forward kinematics finds them, and each Gauss-Newton step is taken in what the poses cannot explain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tensionlab.errors import CalibrationError
from tensionlab.hardware.calibration.gain import quantile
from tensionlab.model import kinematics
from tensionlab.model.module import KINDS
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of the platform; the rotations of a point are ignored."""

    position: Floats  # (K, d) of the reference point, in m
    rotation: Floats  # (K, d, d), platform to world

    @classmethod
    def at(cls, rig: Rig, position: Floats, vectors: Floats | None = None) -> Poses:
        """Return poses of a rig, turned by axes times angles (K, 3), or in the plane by angles (K, 1), in rad."""
        if vectors is None:
            return cls(position, np.tile(np.eye(rig.dimension), (len(position), 1, 1)))
        if rig.dimension == 3:
            return cls(position, kinematics.exponential(vectors))
        return cls(position, kinematics.planar_rotation(vectors[:, 0]))

    def arms(self, rig: Rig) -> Floats | None:
        """Return vectors from reference point to attachments, in world axes, (K, m, d); None for a point."""
        return kinematics.rotate(self.rotation, rig.attachments) if KINDS[rig.kind].has_orientation else None

    def take(self, index: Integers) -> Poses:
        """Return some of the poses."""
        return Poses(self.position[index], self.rotation[index])


@dataclass(frozen=True, eq=False)
class AnchorEstimate:
    """Anchors estimated from cable lengths, with their uncertainty, which is NaN without a degree of freedom."""

    anchors: Floats  # (m, d) in m in world axes
    offsets: Floats  # (m,) excess of each measured length in m; zeros if not fitted
    deviations: Floats  # (m, d) standard deviations of the anchors' coordinates, in m
    sigma: float  # standard deviation of one measured length, in m
    freedom: int  # number of lengths minus all that was fitted to them
    poses: Poses

    @property
    def intervals(self) -> Floats:
        """Half of the 95 % interval of each coordinate, (m, d), in m."""
        return quantile(self.freedom) * self.deviations


@dataclass(frozen=True, eq=False)
class AnchorProblem:
    """Lengths to be fitted, by shared parameters (anchors row by row, and offsets if there are any) and poses."""

    rig: Rig
    lengths: Floats
    known: bool
    offsets: bool

    @property
    def gauge(self) -> int:
        """Number of combinations of anchors that no length depends on: rigid motions, at unknown poses."""
        d = self.rig.dimension
        return 0 if self.known else d * (d + 1) // 2

    @property
    def spare(self) -> int:
        """Number of lengths of one pose that remain to determine anchors."""
        return self.rig.m - (0 if self.known else self.rig.n)

    @property
    def size(self) -> int:
        """Number of shared parameters."""
        return self.rig.m * (self.rig.dimension + self.offsets)

    def split(self, shared: Floats) -> tuple[Floats, Floats]:
        """Return anchors and offsets."""
        m, d = self.rig.m, self.rig.dimension
        return shared[: m * d].reshape(m, d), shared[m * d :] if self.offsets else np.zeros(m)

    def fit_poses(self, shared: Floats, poses: Poses) -> Poses:
        """Return the poses that fit the lengths best, near these; known ones as they are."""
        if self.known:
            return poses
        anchors, offsets = self.split(shared)
        turns = KINDS[self.rig.kind].has_orientation
        position, rotation, _, _ = kinematics.solve_pose(
            np.broadcast_to(anchors, (len(self.lengths), *anchors.shape)),
            self.rig.attachments if turns else None,
            self.lengths - offsets,
            poses.position,
            poses.rotation if turns else None,
            self.rig.pulleys,
        )
        return Poses(position, poses.rotation if rotation is None else rotation)

    def residuals(self, shared: Floats, poses: Poses) -> Floats:
        """Return measured minus modelled lengths, (K, m)."""
        anchors, offsets = self.split(shared)
        modelled, _ = kinematics.cables(anchors, poses.position, poses.arms(self.rig), self.rig.pulleys)
        return self.lengths - offsets - modelled

    def squares(self, shared: Floats, poses: Poses) -> Floats:
        """Return the sum of squared residuals of each pose, (K,)."""
        return np.asarray(np.sum(self.residuals(shared, poses) ** 2, axis=1))

    def jacobian(self, shared: Floats, poses: Poses) -> Floats:
        """Return the derivatives of the lengths by shared parameters, (K m, p), less what the poses take up."""
        anchors, _ = self.split(shared)
        arms = poses.arms(self.rig)
        _, directions = kinematics.cables(anchors, poses.position, arms, self.rig.pulleys)
        count, m, d = directions.shape
        rows = np.zeros((count, m, self.size))
        for j in range(m):
            rows[:, j, j * d : (j + 1) * d] = directions[:, j]
            if self.offsets:
                rows[:, j, m * d + j] = 1.0
        if not self.known:
            q, _ = np.linalg.qr(np.swapaxes(kinematics.structure_matrix(directions, arms), -1, -2))
            rows -= q @ (np.swapaxes(q, -1, -2) @ rows)
        return rows.reshape(-1, self.size)

    def length_error(self, shared: Floats, poses: Poses) -> float:
        """Return the root mean square error of the lengths that poses do not explain, in m."""
        squares = self.squares(shared, self.fit_poses(shared, poses))
        return math.sqrt(float(squares.sum()) / (len(squares) * self.spare))


def calibrate_anchors(
    rig: Rig, lengths: Floats, poses: Poses | None = None, *, known: bool = False, offsets: bool = False
) -> AnchorEstimate:
    """Estimate the anchors of a rig from measured cable lengths (K, m) in m, a row for each pose.

    The nominal rig gives attachments, a first guess of the anchors, and the choice among all equal answers. Poses
    that are not `known` are sought from those given, or from the rig's home. For a platform, rough ones are worth
    having: from the home of a rig with crossed cables (CoGiRo) the search often ends near the best answer, which
    then fits some tenths worse and shows no other sign. With `offsets`, a constant error of each cable's length is
    found as well. A `CalibrationError` refuses too few poses, and poses that do not determine all anchors.
    """
    if rig.frames:
        moving = f"modules are attached to {', '.join(rig.frames)}, and only fixed anchors can be calibrated"
        raise CalibrationError(f'rig "{rig.name}": {moving}; give a rig in which these bodies are the world')
    if lengths.ndim != 2 or lengths.shape[1] != rig.m or not np.isfinite(lengths).all() or (lengths <= 0.0).any():
        wanted = f"finite lengths above 0 m, of shape (K, {rig.m}): a row for each pose"
        raise CalibrationError(f'rig "{rig.name}": give {wanted}; got shape {lengths.shape}')
    if poses is None:
        if known:
            raise CalibrationError("known poses were announced and none given; add them, or leave them unknown")
        poses = Poses.at(rig, np.tile(rig.home, (len(lengths), 1)))
    problem = AnchorProblem(rig, lengths, known, offsets)
    if problem.spare <= 0:
        few = f"{rig.m} cables for {rig.n} degrees of freedom: unknown poses tell nothing about the anchors"
        raise CalibrationError(f'rig "{rig.name}" has {few}; measure at known poses, or add modules')
    unknown = problem.size - problem.gauge
    fewest = math.ceil(unknown / problem.spare)
    if len(lengths) < fewest:
        what = f"{unknown} unknowns of {rig.m} anchors{' and offsets' if offsets else ''}"
        more = f"measure at {fewest} or more, better twice as many, spread over the whole workspace"
        raise CalibrationError(f"{len(lengths)} poses cannot tell the {what}; {more}")
    shared = np.concatenate([rig.anchors.ravel(), np.zeros(rig.m * offsets)])
    shared, poses = _fit(problem, shared, poses)
    if not known:
        shared, poses = _onto_nominal(problem, shared, poses)
    return _with_uncertainty(problem, shared, poses)


ITERATION_LIMIT = 200
FIRST_DAMPING = 1e-3
STEP_TOLERANCE = 1e-10  # the fit ends where the next step would be shorter than this share of the longest cable
RESTARTS = 3  # number of times poses are sought again from those of their neighbours
LEAST_GAIN = 0.999  # ratio of the squared residuals after and before above which this ends
TRIMMED = 0.7  # share of the poses that anchors are fitted to at first then
NEIGHBOURS = 4  # number of neighbours that each pose tries


def _fit(problem: AnchorProblem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Return the shared parameters and poses, near these, that fit the lengths best by least squares.

    Forward kinematics has many answers, and a pose on a wrong branch pulls all anchors with it. So anchors are
    fitted again without the poses that fit worst, and those are sought again from their neighbours.
    """
    shared, poses = _descend(problem, shared, problem.fit_poses(shared, poses))
    for _ in range(0 if problem.known else RESTARTS):
        squares = problem.squares(shared, poses)
        best = np.argsort(squares)[: max(round(TRIMMED * len(squares)), 2)]
        trial, _ = _descend(replace(problem, lengths=problem.lengths[best]), shared, poses.take(best))
        reseeded = _reseed_from_neighbours(problem, trial, problem.fit_poses(trial, poses))
        trial, trial_poses = _descend(problem, trial, reseeded)
        if float(problem.squares(trial, trial_poses).sum()) > LEAST_GAIN * float(squares.sum()):
            break
        shared, poses = trial, trial_poses
    return shared, poses


def _descend(problem: AnchorProblem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Minimise over the shared parameters by Levenberg-Marquardt."""
    error = problem.residuals(shared, poses)
    damping, longest = FIRST_DAMPING, float(problem.lengths.max())
    for _ in range(ITERATION_LIMIT):
        rows = problem.jacobian(shared, poses)
        # Rigid motions change nothing: with the damping as a ridge, steps leave them alone.
        ridge = math.sqrt(damping * float(np.mean(rows**2)) * len(rows)) * np.eye(problem.size)
        values = np.append(error.ravel(), np.zeros(problem.size))
        step = np.linalg.lstsq(np.vstack([rows, ridge]), values, rcond=None)[0]
        trial = shared + step
        trial_poses = problem.fit_poses(trial, poses)
        trial_error = problem.residuals(trial, trial_poses)
        better = float(np.sum(trial_error**2)) < float(np.sum(error**2))
        if better:
            shared, poses, error = trial, trial_poses, trial_error
        damping = max(damping / 10.0, 1e-14) if better else damping * 10.0
        if float(np.abs(step).max()) <= STEP_TOLERANCE * longest or damping > 1e8:
            break
    return shared, poses


def _reseed_from_neighbours(problem: AnchorProblem, shared: Floats, poses: Poses) -> Poses:
    """Solve each pose again from neighbours that fit well, and return the better ones."""
    squares = problem.squares(shared, poses)
    good = np.argsort(squares)[: max(len(squares) // 2, 1)]
    apart = np.linalg.norm(problem.lengths[:, None] - problem.lengths[None, good], axis=-1)
    nearest = good[np.argsort(apart, axis=1)[:, :NEIGHBOURS]]
    for start in (poses.take(column) for column in nearest.T):
        trial = problem.fit_poses(shared, start)
        trial_squares = problem.squares(shared, trial)
        better = trial_squares < squares
        position = np.where(better[:, None], trial.position, poses.position)
        rotation = np.where(better[:, None, None], trial.rotation, poses.rotation)
        poses, squares = Poses(position, rotation), np.where(better, trial_squares, squares)
    return poses


def _onto_nominal(problem: AnchorProblem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Move the rig as one so that its anchors are closest to the nominal ones (Kabsch 1976), without mirroring."""
    anchors, offsets = problem.split(shared)
    nominal = problem.rig.anchors
    here, there = anchors.mean(axis=0), nominal.mean(axis=0)
    turn = kinematics.fit_rotation(anchors, nominal - there)
    moved = (anchors - here) @ turn.T + there
    moved_poses = Poses((poses.position - here) @ turn.T + there, turn @ poses.rotation)
    return np.concatenate([moved.ravel(), offsets if problem.offsets else []]), moved_poses


# A motion of the anchors that changes lengths by less than this share of what the strongest does goes unseen.
WEAK = 1e-5
# So does an anchor uncertain by more than this share of the longest cable: the fit is not linear over such a span.
VAGUE = 0.1


def _with_uncertainty(problem: AnchorProblem, shared: Floats, poses: Poses) -> AnchorEstimate:
    """Return the estimate with its uncertainty; raise if poses do not determine all anchors."""
    anchors, offsets = problem.split(shared)
    # The gauge: the anchors do not move as one with respect to the nominal rig.
    held = _rigid_motions(problem.rig.anchors, problem.size)[:, : problem.gauge]
    free = np.linalg.svd(held, full_matrices=True)[0][:, held.shape[1] :]
    _, strength, vt = np.linalg.svd(problem.jacobian(shared, poses) @ free, full_matrices=False)
    error = problem.residuals(shared, poses)
    freedom = len(error) * problem.spare - (problem.size - problem.gauge)
    sigma = math.sqrt(float(np.sum(error**2)) / freedom) if freedom > 0 else math.nan
    if strength[-1] < WEAK * strength[0] or sigma / strength[-1] > VAGUE * problem.lengths.max():
        moved = np.linalg.norm(problem.split(free @ vt[-1])[0], axis=1)
        unseen = [problem.rig.modules[j].name for j in np.argsort(-moved) if moved[j] > 0.3 * moved.max()]
        turned = ", and turned differently" if KINDS[problem.rig.kind].has_orientation else ""
        raise CalibrationError(
            f"these poses do not tell where the anchors of {', '.join(unseen)} are: they could move and hardly "
            f"change a length. Add poses all over the workspace, in no common plane or line{turned}"
        )
    root = free @ vt.T / strength
    deviations = sigma * np.linalg.norm(root, axis=1)[: anchors.size].reshape(anchors.shape)
    return AnchorEstimate(anchors, offsets, deviations, sigma, freedom, poses)


def _rigid_motions(anchors: Floats, size: int) -> Floats:
    """Return the shared parameters' change in each rigid motion about the origin, (size, d (d + 1) / 2)."""
    m, d = anchors.shape
    motions = [np.tile(axis, (m, 1)) for axis in np.eye(d)]
    for i in range(d):
        for j in range(i):
            turn = np.zeros((d, d))
            turn[i, j], turn[j, i] = 1.0, -1.0
            motions.append(anchors @ turn.T)
    columns = np.zeros((size, len(motions)))
    columns[: m * d] = np.reshape(motions, (len(motions), m * d)).T
    return columns


def calibrated_rig(rig: Rig, found: AnchorEstimate, how: str) -> Rig:
    """Return the nominal rig with the anchors found; its source says how."""
    modules = tuple(
        replace(module, anchor=anchor) for module, anchor in zip(rig.modules, found.anchors, strict=True)
    )
    return replace(rig, modules=modules, source=f"{rig.source}; {how}" if rig.source else how)


FOLDS = 5


def length_errors(
    rig: Rig, lengths: Floats, found: AnchorEstimate, *, known: bool, offsets: bool
) -> dict[str, float]:
    """Return the rms errors of lengths in m, as far as poses do not explain them: before, after, and held out.

    Before is on the nominal rig. Held out is by cross-validation, on rigs calibrated without the lengths: each
    fifth of the poses is left out once; NaN where too few remain. Other arguments as in `calibrate_anchors`.
    """
    nominal_error = AnchorProblem(rig, lengths, known, False).length_error(rig.anchors.ravel(), found.poses)
    squares = 0.0
    for fold in range(FOLDS):
        out = np.arange(len(lengths)) % FOLDS == fold
        try:
            remaining = found.poses.take(np.flatnonzero(~out))
            other = calibrate_anchors(rig, lengths[~out], remaining, known=known, offsets=offsets)
        except CalibrationError:
            squares = math.nan
            break
        problem, poses = AnchorProblem(rig, lengths[out], known, offsets), found.poses.take(np.flatnonzero(out))
        squares += problem.length_error(np.append(other.anchors, other.offsets), poses) ** 2 * int(out.sum())
    return {"before": nominal_error, "after": found.sigma, "held_out": math.sqrt(squares / len(lengths))}
