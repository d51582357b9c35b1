"""Proof of where a rig renders what is required: the statement, and the search over cells of positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab import _native
from tensionlab.errors import InputError
from tensionlab.model import kinematics, pose
from tensionlab.model.bodies import HAND, Body, place_bodies
from tensionlab.model.pose import Frames, frame_of
from tensionlab.model.requirement import Requirement, as_requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats, Integers, check_size
from tensionlab.workspace.certified import Bounds, CertifiedWorkspace, Subdivision, intersection, subdivide
from tensionlab.workspace.interference import cable_pairs, closest_pair, distances_to_placed, with_bodies
from tensionlab.workspace.sweep.executors import evaluate_on_cluster

# Required in place of wrenches: that some tensions above zero balance each other, whatever the limits.
WRENCH_CLOSURE = "wrench-closure"
MAX_ANGLE_RAD = 0.5  # largest angle about a rotation; beyond it, the bounds are useless
# Error of a distance relative to cables and bodies. The kernel measures between points of both, so that it errs
# upwards only, and squares within some roundings (1e-16) of the sum of squared lengths: 1e-8 where they touch.
ROUNDING = 1e-7
CHUNK_CELLS = 16_384  # cells of a task, which then takes a fraction of a second
MAX_CELLS = 50_000_000  # cells of a level that fit in memory

Required = Requirement | ArrayLike | tuple[ArrayLike, float] | Literal["wrench-closure"] | None


def certify(
    rig: Rig,
    region: ArrayLike,
    required: Required = None,
    resolution: ArrayLike = 0.05,
    *,
    rotations: ArrayLike | None = None,
    angle: float = 0.0,
    clearance: float | None = None,
    bodies: Sequence[Body] | None = None,
    losses: int = 0,
    gap: float = 0.0,
    frames: Frames | None = None,
    scheduler: str | None = None,
    progress: Callable[[float, Bounds], None] | None = None,
) -> CertifiedWorkspace:
    """Prove where in a region every pose of a rig renders all that is required, and where none does.

    Cells of positions are proved as a whole, or split in two along all axes, down to the resolution. A cell is
    inside if the available wrench set exceeds the required one in all directions normal to its facets, as they
    turn with the pose, or, with an angle, if tensions that follow the pose keep their limits; it is outside if the
    set does not reach the required one in one direction. Of the undecided cells a share is proved as well, so that
    the bounds of the volume converge as the square of the resolution. Rounding is part of every bound.

    Source: Gouttefarde, Daney and Merlet, "Interval-analysis-based determination of the wrench-feasible workspace
    of parallel cable-driven robots", 2011, for the proof of cells; Bouchard, Gosselin and Moore, "On the ability
    of a cable-driven robot to generate a prescribed set of wrenches", 2010, for the facets. That these may turn is
    shown in ``tensionlab/native/workspace/certify.cpp``, bounds for orientations in ``cell_columns.hpp`` and
    ``tension_policy.hpp`` there, and those for pulleys in ``pulley_bend.hpp``. Over pulleys the bounds are further
    apart, and clearance cannot be proved; a position with an attachment inside its pulley is outside.

    InputError, ShapeError or RigError if an argument does not suit the rig, or for more cells than fit in memory.

    Parameters
    ----------
    region : (d, 2) array
        Box of positions: where it starts and ends along each axis, in m. It may have no extent along an axis.
    required : Requirement, array, tuple, "wrench-closure" or None
        As in `tensionlab.sweep`; or a ball ``(centre, radius)``. "wrench-closure" is that some tensions balance
        each other, whatever the limits.
    resolution : float, or one for each axis
        Longest edge of the finest cells, in m.
    rotations : array, optional
        Orientations, one or several, as in `Rig.structure_matrix`. A position is inside if it is so in all of
        them, and outside if it is so in one. Left out: the identity.
    angle : float
        All orientations within this angle, in rad, of each of the rotations count as well.
    clearance : float, optional
        Distance in m that cables must keep from each other, but for those that share an end.
    bodies : sequence of Body, optional
        In place of `Rig.bodies`: cables keep the margin of each, however it sways; () for none. This part of the
        border, and that of the clearance, are bounded to first order only.
    losses : 0 or 1
        1: the proof holds after the loss of any one cable, which then has tension zero, not its minimum.
        `CertifiedWorkspace.losses` has the proof for each.
    gap : float
        Undecided share of the region at which it stops dividing cells, if the resolution does not end it before.
    frames, scheduler
        As in `tensionlab.sweep`.
    progress : callable, optional
        Called with the decided share of the region, and the bounds of the workspace's volume until then.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> region = [[-0.4, 0.4], [0.0, 1.6], [-0.4, 0.4]]
    >>> proved = tl.workspace.certify(rig, region, ([0.0, 0.0, 0.0], 1.0), 0.02)
    >>> print(f"1 N in every direction in {proved.volume.lower:.3f} to {proved.volume.upper:.3f} m³")
    1 N in every direction in 0.095 to 0.097 m³
    """
    if bodies is not None:
        rig = with_bodies(rig, bodies)
    if not 0.0 <= gap < 1.0:
        raise InputError(f"gap is {gap}; give a share of the region, from 0 to less than 1")
    if losses not in (0, 1):
        raise InputError(f"losses is {losses}; give 0, or 1 for the loss of any one cable")
    problem = cell_problem(rig, required, rotations, angle, frames, clearance)
    if (free := int((problem.lower < problem.upper).sum())) < rig.n + losses:
        raise InputError(
            f'rig "{rig.name}" has {rig.n} wrench components and {free} cables whose tension can change'
            + ", so nothing survives the loss of one" * losses
            + f"; give it {rig.n + losses} or more"
        )
    cells = subdivide(region, resolution, rig.dimension)
    if isinstance(required, str):
        words = "wrench closure"
    else:
        words = (rig.required if required is None else as_requirement(required)).describe(rig)
    if clearance is not None:
        words += f", cables {clearance:g} m apart"
    if rig.bodies:
        words += f", cables clear of {', '.join(body.name for body in rig.bodies)}"
    if not losses:
        return _prove_cells(rig, problem, words, cells, gap, scheduler, progress)
    proofs: dict[str, CertifiedWorkspace] = {}
    for number, module in enumerate(rig.modules):

        def report(settled: float, bounds: Bounds, number: int = number) -> None:
            if progress is not None:
                progress((number + settled) / rig.m, bounds)

        name, reduced = module.name, problem.without(number)
        proofs[name] = _prove_cells(rig, reduced, f"{words}, {name} lost", cells, gap, scheduler, report)
    return intersection(proofs, f"{words}, any one cable lost")


def _prove_cells(
    rig: Rig,
    problem: CellProblem,
    words: str,
    cells: Subdivision,
    gap: float,
    scheduler: str | None,
    progress: Callable[[float, Bounds], None] | None,
) -> CertifiedWorkspace:
    """Prove a statement, with its words, about all cells: level by level, down to the last or to the gap."""
    leaves: list[tuple[NDArray[np.int8], Integers, NDArray[np.int8], Floats]] = []
    settled, proved, places = 0.0, np.zeros(2), cells.first()  # volumes that are settled, and inside and outside
    evaluations = 0
    for level in range(cells.levels + 1):
        if len(places) > MAX_CELLS:
            size = f"{len(places):,} cells are undecided at {cells.edges(level).max():.2g} m"
            raise InputError(f"resolution: {size}; give a longer one, or a smaller region")
        evaluations += len(places)
        cell_volume = float(cells.cell_volume(level))
        undecided, starts = [places[:0]], range(0, len(places), CHUNK_CELLS)
        tasks = [CellTask(problem, cells, level, places[start : start + CHUNK_CELLS]) for start in starts]
        here = ((task, task.evaluate()) for task in tasks)
        for task, verdicts in here if scheduler is None else evaluate_on_cluster(scheduler, tasks):
            divided = (verdicts.verdict == 0) & (level < cells.levels)
            undecided.append(task.places[divided])
            done = ~divided
            own = task.places[done]
            leaves.append((np.full(len(own), level, np.int8), own, verdicts.verdict[done], verdicts.shares[done]))
            settled, proved = settled + len(own) * cell_volume, proved + leaves[-1][3].sum(axis=0) * cell_volume
            if progress is not None:
                progress(settled / cells.volume, Bounds(proved[0], cells.volume - proved[1]))
        remaining = np.concatenate(undecided)
        if len(remaining) * cell_volume <= gap * cells.volume:
            nothing = np.zeros(len(remaining), np.int8), np.zeros((len(remaining), 2))
            leaves.append((np.full(len(remaining), level, np.int8), remaining, *nothing))
            break
        places = cells.children(remaining)
    level_of, place, verdict, shares = map(np.concatenate, zip(*leaves, strict=True))
    return CertifiedWorkspace(rig, problem.anchors[0], words, cells, level_of, place, verdict, shares, evaluations)


class CellTask(NamedTuple):
    """Cells of one level (k, d), and the statement to prove of them."""

    problem: CellProblem
    cells: Subdivision
    level: int
    places: Integers

    def evaluate(self) -> Verdicts:
        """Prove what is inside and outside."""
        centres = self.cells.centres(self.level, self.places)
        return self.problem.prove(centres, self.cells.edges(self.level) / 2, self.level == self.cells.levels)


class Verdicts(NamedTuple):
    """Verdicts about cells."""

    verdict: NDArray[np.int8]  # 1 inside, -1 outside, 0 neither, (k,)
    shares: Floats  # proved inside and outside, (k, 2)


class ClearanceProblem(NamedTuple):
    """Distances that cables must keep from each other and from bodies."""

    clearance: float  # between the pairs, in m
    pairs: Integers  # of cables, (b, 2)
    bodies: tuple[Body, ...]  # of which cables must keep the margins
    rotations: Floats  # of the platform, (k, d, d)
    frames: Frames  # poses of the frames of bodies

    def decide(
        self, anchors: Floats, arms: Floats, angle: float, centres: Floats, half_edges: Floats
    ) -> NDArray[np.int8]:
        """Return 1 for cells (k) that are clear in all poses, -1 for those that are not in any, 0 for the others.

        Anchors and arms are (rotations, m, d). The distance of two cables changes by no more than the platform
        moves: points at the shares s and t of their lengths come closer by |s - t| of its shift at most, and by s
        and t of what their attachments turn by. So does that of a cable and a body, be it in the world or held.
        """
        reach, longest_arm = float(np.linalg.norm(half_edges)), float(np.linalg.norm(arms, axis=-1).max())
        turns = angle * (longest_arm + np.array([longest_arm, *map(_arm, self.bodies)]))
        margins = np.array([self.clearance, *(body.margin for body in self.bodies)])
        segments = [body.end - body.start for body in self.bodies if body.end is not None]
        longest_body = max((float(np.linalg.norm(segment)) for segment in segments), default=0.0)
        clear = np.ones(len(centres), np.int8)
        for own_anchors, own_arms, rotation in zip(anchors, arms, self.rotations, strict=True):
            ends = centres[:, None] + own_arms
            cables = np.stack([np.broadcast_to(own_anchors, ends.shape), ends], axis=-2)
            rounding = ROUNDING * (np.linalg.norm(own_anchors - ends, axis=-1).max(axis=-1) + longest_body)
            apart = closest_pair(cables, self.pairs).distance[:, None]
            placed = place_bodies(self.bodies, centres, rotation, self.frames)
            distances = np.hstack([apart, distances_to_placed(cables, self.bodies, placed).min(axis=-2)])
            slack, doubt = distances - margins, reach + turns + rounding[:, None]
            verdict = np.where(slack >= doubt, 1, np.where(slack < -doubt, -1, 0)).min(axis=-1)
            clear = np.minimum(clear, verdict.astype(np.int8))
        return clear


def _arm(body: Body) -> float:
    """Return the largest distance of a held body's segment, or of its corners, from the reference point, in m."""
    if body.frame != HAND:
        return 0.0
    corner = 0.0 if body.size is None else float(np.linalg.norm(body.size)) / 2
    return corner + max(float(np.linalg.norm(end)) for end in (body.start, body.end) if end is not None)


def clearance_problem(
    rig: Rig, clearance: float | None, rotations: Floats, frames: Frames | None
) -> ClearanceProblem | None:
    """Return the distances to prove, or None if none is required."""
    if clearance is None and not rig.bodies:
        return None
    if clearance is not None and not (np.isfinite(clearance) and clearance >= 0):
        raise InputError(f"clearance is {clearance}; give a distance in m, 0 or more")
    pairs = cable_pairs(rig)[: 0 if clearance is None else None]
    places = {name: frame_of(where) for name, where in (rig.at_rest | dict(frames or {})).items()}
    if any(np.ndim(where.position) > 1 for where in places.values()):
        raise InputError("frames: give one pose for each body frame; it is the same all over the region")
    return ClearanceProblem(clearance or 0.0, pairs, rig.bodies, rotations, places)


class CellProblem(NamedTuple):
    """Rig at some rotations (k), all of which count, and what is required of it."""

    anchors: Floats  # in world axes, (k, m, d) in m
    arms: Floats  # (k, m, d)
    lower: Floats  # limits in N, (m,)
    upper: Floats
    wrenches: Floats  # that are required, torques divided by the length, (k, w, n)
    radius: float  # all wrenches within it of those are required as well
    slack: float  # by which wrenches change with the rotations within the angle
    angle: float  # all rotations within it of each count as well, in rad
    length: float
    closure: bool  # wrench closure is required in place of the wrenches
    radii: Floats | None = None  # of pulleys, (m,)
    axes: Floats | None = None  # of pulleys, (m, d)
    weight: tuple[Floats, Floats] | None = None  # that is held as well, (d,) in N, and its arms (k, d)
    clearance: ClearanceProblem | None = None

    def without(self, lost: int) -> CellProblem:
        """Return the statement after the loss of a cable, which need not stay clear of anything either."""
        cable_axis = {"anchors": 1, "arms": 1, "lower": 0, "upper": 0, "radii": 0, "axes": 0}
        kept: dict[str, Any] = {
            name: np.delete(array, lost, axis)
            for name, axis in cable_axis.items()
            if (array := getattr(self, name)) is not None
        }
        if self.clearance is not None:
            pairs = self.clearance.pairs
            pairs = pairs[(pairs != lost).all(axis=1)]
            kept["clearance"] = self.clearance._replace(pairs=pairs - (pairs > lost))
        return self._replace(**kept)

    def prove(self, centres: Floats, half_edges: Floats, shares: bool) -> Verdicts:
        """Return what is proved of cells with these centres (k, d) and half edges (d,), in m.

        The shares are 0 and 1 alone unless they are wanted.
        """
        if self.clearance is None:
            return self._prove_wrenches(centres, half_edges, shares)
        clear = self.clearance.decide(self.anchors, self.arms, self.angle, centres, half_edges)
        verdict, proved_shares = clear.copy(), _whole(clear)
        free = clear >= 0
        verdict[free], proved_shares[free] = self._prove_wrenches(centres[free], half_edges, shares)
        unclear = (clear == 0) & (verdict >= 0)
        verdict[unclear], proved_shares[unclear, 0] = 0, 0.0
        return Verdicts(verdict, proved_shares)

    def _prove_wrenches(self, centres: Floats, half_edges: Floats, shares: bool) -> Verdicts:
        problem = self if self.weight is None else self._with_weight(*self.weight)
        cells = (self.weight is not None, np.ascontiguousarray(centres), half_edges, shares)
        verdict, proved_shares = _native.certify_cells(*problem[:-2], *cells)  # all but the clearance
        return Verdicts(verdict, _whole(verdict) if proved_shares is None else proved_shares)

    def _with_weight(self, force: Floats, arms: Floats) -> CellProblem:
        """Return the statement with the weight as the last cable: its anchor is the force, its tension 1."""
        pulleys: dict[str, Any] = {}
        if self.radii is not None and self.axes is not None:
            pulleys = {"radii": np.append(self.radii, 0.0), "axes": np.vstack([self.axes, np.zeros(len(force))])}
        return self._replace(
            anchors=np.concatenate([self.anchors, np.broadcast_to(force, arms[:, None].shape)], axis=1),
            arms=np.concatenate([self.arms, arms[:, None]], axis=1),
            lower=np.append(self.lower, 1.0),
            upper=np.append(self.upper, 1.0),
            **pulleys,
        )


def _whole(verdict: NDArray[np.int8]) -> Floats:
    """Return the proved shares (k, 2) of cells that are inside as a whole, outside, or undecided."""
    return np.asarray(np.stack([verdict > 0, verdict < 0], axis=1), dtype=np.float64)


def _orientations(rig: Rig, rotations: ArrayLike | None) -> tuple[Floats | None, Floats]:
    """Return the rotations as a sequence: as they were given, and as matrices (k, d, d)."""
    if rotations is None:
        return None, rig.home_matrix[None]
    turns, d = np.asarray(rotations), rig.dimension
    turns = turns[None] if turns.ndim == (0 if d == 2 else 2) else turns
    matrices = pose.rotations(turns, d, "rotations")
    if matrices.ndim != 3 or not len(matrices):
        raise InputError(f"rotations has shape {matrices.shape}; give one, or several in a row")
    return turns, matrices


def cell_problem(
    rig: Rig,
    required: Required,
    rotations: ArrayLike | None,
    angle: float,
    frames: Frames | None,
    clearance: float | None,
) -> CellProblem:
    """Return the statement to prove; parameters and errors as in `certify`."""
    rig.require_position("proofs of a workspace")
    d, n, m = rig.dimension, rig.n, rig.m
    check_size(n, m)
    if not (np.isfinite(angle) and 0 <= angle <= MAX_ANGLE_RAD):
        raise InputError(f"angle is {angle}; give an angle in rad, 0 to {MAX_ANGLE_RAD}")
    if n == d and (rotations is not None or angle):
        raise InputError(f'rig "{rig.name}" is a {rig.kind} rig and cannot turn; leave rotations and angle out')
    pulleys = rig.pulleys_in_world(frames)
    if pulleys is not None and (clearance is not None or rig.bodies):
        advice = "the proof of clearance holds for fixed anchors; leave clearance out and pass bodies=()"
        raise InputError(f'rig "{rig.name}" has pulleys, and {advice}')
    pose.require_known(frames or (), rig.at_rest)
    anchors = pose.place_anchors(rig.modules, rig.anchors, frames)
    if anchors.ndim > 2:
        raise InputError("frames: give one pose for each body frame; it is the same all over the region")
    turns, matrices = _orientations(rig, rotations)
    arms = kinematics.rotate(matrices, rig.attachments) if n > d else np.zeros((1, m, d))
    lower, upper, radius, slack, length = rig.limits.lower, rig.limits.upper, 0.0, 0.0, 1.0
    weight = None
    closure = isinstance(required, str)
    if isinstance(required, str):
        if required != WRENCH_CLOSURE:
            raise InputError(f'required is {required!r:.40}; give wrenches, a Requirement, or "{WRENCH_CLOSURE}"')
        lower, upper = np.zeros(m), np.ones(m)
        wrenches = np.zeros((len(arms), 1, n))
        length = rig.characteristic_length
    else:
        wanted = rig.required if required is None else as_requirement(required)
        wanted.check_rig(rig)
        length = wanted.length_for(rig) if n > d else 1.0
        if angle and wanted.gravity and m < _native.MAX_CABLES and rig.platform is not None:
            com = np.zeros(d) if rig.platform.com is None else rig.platform.com
            weight, wanted = (rig.gravity()[:d], matrices @ com), replace(wanted, gravity=False)
        corners = wanted.at(rig, turns) / wanted.divisors(rig)
        wrenches = np.broadcast_to(corners, (len(arms), *corners.shape[-2:]))
        radius = wanted.ball
        slack = wanted.turned_torque(rig, angle) / length
    anchors, arms, lower, upper, wrenches = (
        np.ascontiguousarray(array)
        for array in (np.broadcast_to(anchors, arms.shape), arms, lower, upper, wrenches)
    )
    radii, axes = (None, None) if pulleys is None else map(np.ascontiguousarray, pulleys)
    keeps = clearance_problem(rig, clearance, matrices, frames)
    statement = (radius, slack, float(angle), length, closure, radii, axes, weight, keeps)
    return CellProblem(anchors, arms, lower, upper, wrenches, *statement)
