"""Calibration of the anchors of a rig from the lengths of its cables.

At known poses each cable is by itself: its anchor is where its lengths meet (multilateration). At unknown ones a
rig with more cables than freedoms calibrates itself: each pose brings m lengths and n unknowns, and what is left
over speaks of the anchors. See Borgstrom et al. 2009, "NIMS-PL: A Cable-Driven Robot With Self-Calibration
Capabilities", IEEE Transactions on Robotics 25(5); Jin et al. 2018, Sensors 18(7); and for the idea in use,
Hangprinter's auto-calibration. What lengths alone cannot tell is taken from the nominal rig: where the rig stands
and how it is turned (the result is moved so that its anchors are closest to the nominal ones), and its mirror
image. An error of all lengths in the same proportion, such as a wrong spool radius, cannot be seen either: the rig
is found larger by as much.

Poses are eliminated (variable projection, Golub and Pereyra 1973, in Kaufman's approximation): for given anchors
forward kinematics finds them, and each Gauss-Newton step is taken in what the poses cannot explain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tensionlab.errors import CalibrationError
from tensionlab.hardware.calibration.anchor_fit import AnchorProblem, Poses, advice, best_fit
from tensionlab.hardware.calibration.gain import quantile
from tensionlab.model.kinematics import fit_rotation
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats

# A motion of the anchors that changes lengths by less than this share of what the strongest does goes unseen.
WEAK = 1e-5
# So does an anchor uncertain by more than this share of the longest cable: the fit is not linear over such a span.
VAGUE = 0.1


@dataclass(frozen=True, eq=False)
class AnchorEstimate:
    """Anchors (m, d) estimated from cable lengths, in m in world axes, with their uncertainty.

    `offsets` (m,) is what each measured length is too long by, in m, zeros if not fitted. `covariance` (p, p), in
    m², is of the anchors, row by row, and then of offsets that are fitted. `sigma` is the standard deviation of
    one measured length, in m. Both are NaN without a degree of `freedom`: lengths less all that was fitted to
    them. `residuals` (K, m) are measured less modelled lengths, in m.
    """

    anchors: Floats
    offsets: Floats
    covariance: Floats
    sigma: float
    freedom: int
    residuals: Floats
    poses: Poses

    @property
    def deviations(self) -> Floats:
        """Standard deviation of each coordinate of the anchors, (m, d), in m."""
        return np.sqrt(np.diag(self.covariance)[: self.anchors.size]).reshape(self.anchors.shape)

    @property
    def intervals(self) -> Floats:
        """Half of the 95 % interval of each coordinate, (m, d), in m."""
        return quantile(self.freedom) * self.deviations


def calibrate_anchors(
    rig: Rig, lengths: Floats, poses: Poses | None = None, *, known: bool = False, offsets: bool = False
) -> AnchorEstimate:
    """Estimate the anchors of a rig from measured cable lengths (K, m) in m, a row for each pose.

    The nominal rig gives attachments, a first guess of the anchors, and which of all equal answers is meant. Poses
    that are not `known` are sought from those given, or from the rig's home. For a platform, rough ones are worth
    having: from the home of a rig with crossed cables (CoGiRo) the search often ends near the best answer, which
    then fits some tenths worse and shows no other sign. With `offsets`, a constant error of each cable's length is
    found as well.

    Raises
    ------
    CalibrationError
        Too few poses, or such that not all anchors can be seen; the message says which to add.
    """
    if rig.frames:
        raise CalibrationError(
            f'rig "{rig.name}": modules are attached to {", ".join(rig.frames)}; only fixed anchors can be '
            "calibrated: hold the bodies still, and give a rig in which they are the world"
        )
    if lengths.ndim != 2 or lengths.shape[1] != rig.m or not np.isfinite(lengths).all() or (lengths <= 0.0).any():
        raise CalibrationError(
            f'rig "{rig.name}": give finite lengths above 0 m, a row for each pose and a column for each of its '
            f"{rig.m} modules; got shape {lengths.shape}"
        )
    if poses is None:
        if known:
            raise CalibrationError("known poses were announced and none given; add them, or leave them unknown")
        poses = Poses.at(rig, np.tile(rig.home, (len(lengths), 1)))
    problem = AnchorProblem(rig, lengths, known, offsets)
    _require_enough(problem)
    shared = np.concatenate([rig.anchors.ravel(), np.zeros(rig.m * offsets)])
    shared, poses = best_fit(problem, shared, poses)
    if not known:
        shared, poses = _onto_nominal(problem, shared, poses)
    return _judged(problem, shared, poses)


def _require_enough(problem: AnchorProblem) -> None:
    rig, count = problem.rig, len(problem.lengths)
    if problem.spare <= 0:
        raise CalibrationError(
            f'rig "{rig.name}" has {rig.m} cables for {rig.n} freedoms: lengths at unknown poses say nothing '
            "about the anchors; measure at known poses, or add modules"
        )
    unknown = problem.size - problem.gauge
    least = math.ceil(unknown / problem.spare)
    if count < least:
        raise CalibrationError(
            f"{count} pose{'s' if count != 1 else ''} cannot tell the {unknown} unknowns of {rig.m} anchors"
            f"{' and offsets' if problem.offsets else ''}; measure at {least} or more, twice as many if you can, "
            "spread over the whole workspace"
        )


def _onto_nominal(problem: AnchorProblem, shared: Floats, poses: Poses) -> tuple[Floats, Poses]:
    """Move the rig as one so that its anchors are closest to the nominal ones (Kabsch 1976), without mirroring."""
    anchors, offsets = problem.split(shared)
    nominal = problem.rig.anchors
    here, there = anchors.mean(axis=0), nominal.mean(axis=0)
    turn = fit_rotation(anchors, nominal - there)
    moved = (anchors - here) @ turn.T + there
    rotation = None if poses.rotation is None else turn @ poses.rotation
    return (
        np.concatenate([moved.ravel(), offsets if problem.offsets else []]),
        Poses((poses.position - here) @ turn.T + there, rotation),
    )


def _judged(problem: AnchorProblem, shared: Floats, poses: Poses) -> AnchorEstimate:
    """Return the estimate with its uncertainty; raise if poses do not determine all anchors."""
    anchors, offsets = problem.split(shared)
    rows = problem.jacobian(shared, poses).reshape(-1, problem.size)
    # The gauge: the anchors do not move as one with respect to the nominal rig.
    held = _rigid_motions(problem.rig.anchors, problem.size)[:, : problem.gauge]
    free = np.linalg.svd(held, full_matrices=True)[0][:, held.shape[1] :]
    _, strength, vt = np.linalg.svd(rows @ free, full_matrices=False)
    error = problem.residuals(shared, poses)
    freedom = len(error) * problem.spare - (problem.size - problem.gauge)
    sigma = math.sqrt(float(np.sum(error**2)) / freedom) if freedom > 0 else math.nan
    unseen = strength[-1] < WEAK * strength[0]
    if unseen or sigma / strength[-1] > VAGUE * problem.lengths.max():
        names = [module.name for module in problem.rig.modules]
        weak = free @ vt[-1]
        moved = np.linalg.norm(problem.split(weak)[0], axis=1)
        worst = [names[j] for j in np.argsort(-moved) if moved[j] > 0.3 * moved.max()]
        raise CalibrationError(
            f"these poses do not tell where the anchors of {', '.join(worst)} are: they could move and "
            f"hardly change a length. Add poses such as {advice(problem, shared, weak)}"
        )
    root = free @ vt.T / strength
    return AnchorEstimate(anchors, offsets, sigma**2 * (root @ root.T), sigma, freedom, error, poses)


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
    for index, motion in enumerate(motions):
        columns[: m * d, index] = motion.ravel()
    return columns


def calibrated_rig(rig: Rig, found: AnchorEstimate, how: str) -> Rig:
    """Return the nominal rig with the anchors found; its source says how."""
    modules = tuple(
        replace(module, anchor=anchor) for module, anchor in zip(rig.modules, found.anchors, strict=True)
    )
    source = f"{rig.source}; {how}" if rig.source else how
    return replace(rig, modules=modules, source=source)


FOLDS = 5


def nominal_misfit(rig: Rig, lengths: Floats, poses: Poses, *, known: bool) -> float:
    """Return the misfit of lengths to the nominal rig, in m, as `AnchorProblem.misfit`."""
    return AnchorProblem(rig, lengths, known, False).misfit(rig.anchors.ravel(), poses)


def held_out_misfit(rig: Rig, lengths: Floats, poses: Poses, *, known: bool, offsets: bool) -> float:
    """Return the misfit of lengths to a rig that was calibrated without them, in m.

    Cross-validation: each fifth of the poses is left out once. NaN where too few poses remain to calibrate with.
    Arguments as those of `calibrate_anchors`.
    """
    squares = []
    for fold in range(FOLDS):
        out = np.arange(len(lengths)) % FOLDS == fold
        try:
            found = calibrate_anchors(
                rig, lengths[~out], poses.take(np.flatnonzero(~out)), known=known, offsets=offsets
            )
        except CalibrationError:
            return math.nan
        shared = np.append(found.anchors, found.offsets)
        left = AnchorProblem(rig, lengths[out], known, offsets)
        squares.append(left.misfit(shared, poses.take(np.flatnonzero(out))) ** 2 * int(out.sum()))
    return math.sqrt(sum(squares) / len(lengths))
