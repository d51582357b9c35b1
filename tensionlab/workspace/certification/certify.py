"""Proof of where a rig renders what is required: `certify`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from os import PathLike
from pathlib import Path

from numpy.typing import ArrayLike

from tensionlab.errors import WriteError
from tensionlab.model.pose import Frames
from tensionlab.model.requirement import as_requirement
from tensionlab.model.rig import Rig
from tensionlab.support.files import writing
from tensionlab.workspace.certification.clearance import clearance_problem
from tensionlab.workspace.certification.problem import Required, Verdicts, cell_problem
from tensionlab.workspace.certification.result import CertifiedWorkspace
from tensionlab.workspace.certification.search import CellSearch, CellTask, run
from tensionlab.workspace.certification.subdivision import subdivide
from tensionlab.workspace.interference import Capsule
from tensionlab.workspace.sweep.executors import evaluate_on_cluster

SUFFIX = ".npz"  # file of a proof

Progress = Callable[[float], None]


def certify(
    rig: Rig,
    region: ArrayLike,
    required: Required = None,
    resolution: ArrayLike = 0.05,
    *,
    rotations: ArrayLike | None = None,
    angle: float = 0.0,
    clearance: float | None = None,
    bodies: Sequence[Capsule] = (),
    frames: Frames | None = None,
    out: str | PathLike[str] | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> CertifiedWorkspace:
    """Prove where in a region every pose of a rig renders all that is required, and where none does.

    A sweep says nothing about what is between its positions. Here cells of positions are proved as a whole, or cut
    in two along all axes, down to the resolution. What is undecided then lies along the border; of that a share is
    proved as well, so that the bounds of the volume come together as the square of the resolution.

    A cell is inside if the tensions pull further than is required in all directions; that is proved of those in
    which the facets of the available wrench set look, as they turn with the pose. It is outside if they do not in
    one. Rounding is part of every bound.

    Source: Gouttefarde, Daney and Merlet, "Interval-analysis-based determination of the wrench-feasible workspace
    of parallel cable-driven robots", 2011, for the proof of cells; Bouchard, Gosselin and Moore, "On the ability
    of a cable-driven robot to generate a prescribed set of wrenches", 2010, for the facets. That these may turn is
    shown in ``tensionlab/native/workspace/cell_proof.hpp``.

    Parameters
    ----------
    rig : Rig
        Whose poses are looked at.
    region : (d, 2) array
        Box of positions: where it starts and ends along each axis, in m. It may have no extent along an axis.
    required : Requirement, array, tuple, "wrench-closure" or None
        What the cables must exert at every pose: a wrench, the vertices (k, n) of a set, a ball
        ``(centre, radius)``, or a `tensionlab.Requirement`. "wrench-closure" is that some tensions balance each
        other, whatever the limits. None is `Rig.required`.
    resolution : float, or one for each axis
        Longest edge of the finest cells, in m.
    rotations : array, optional
        Orientations, one or several in a row, as in `Rig.structure_matrix`: a position is inside if it is so in
        all of them, outside if in one. Left out: the identity.
    angle : float
        Each of the rotations stands for all that are within this angle of it, in rad.
    clearance : float, optional
        Distance in m that cables must keep from each other, but for those of `cable_pairs`, and from the bodies.
        Its part of the border is bounded to first order only.
    bodies : sequence of Capsule
        In the world, as in `body_distance`.
    frames : mapping of name to Frame or (position, rotation), optional
        Where the body frames of the rig are: one pose for each.
    out : path, optional
        A file NAME.npz, to which cells are written every ten seconds. Called again, an interrupted proof is
        resumed from there, and a finished one is only read.
    scheduler : str, optional
        Address of a Dask scheduler, as in `tensionlab.sweep`; else the processors of this machine do the work.
    progress : callable, optional
        Called with the share of the region that is settled, from 0 to 1.

    Raises
    ------
    InputError, ShapeError, RigError
        If an argument does not suit the rig, or there are more cells than fit in memory.
    DataError, WriteError
        If the file holds something else, or cannot be written.

    Examples
    --------
    >>> import tensionlab as tl
    >>> rig = tl.load_rig("bartels2026-validation")
    >>> region = [[-0.4, 0.4], [0.0, 1.6], [-0.4, 0.4]]
    >>> proved = tl.workspace.certify(rig, region, ([0.0, 0.0, 0.0], 1.0), 0.02)
    >>> print(f"1 N in every direction in {proved.volume.lower:.3f} to {proved.volume.upper:.3f} m³")
    1 N in every direction in 0.095 to 0.097 m³
    """
    problem = cell_problem(rig, required, rotations, angle, frames, clearance_problem(rig, clearance, bodies))
    cells = subdivide(region, resolution, rig.dimension)
    search = CellSearch(problem, cells)
    file = None if out is None else Path(out)
    if file is not None:
        if file.suffix.lower() != SUFFIX:
            raise WriteError(f"{file}: unsupported format; it must end in {SUFFIX}")
        if file.exists():
            search.load(file)
        writing.require_writable(file)

    def report() -> None:
        if progress is not None:
            progress(search.settled / cells.volume)

    def evaluate(tasks: Iterable[CellTask]) -> Iterator[tuple[CellTask, Verdicts]]:
        if scheduler is not None:
            return evaluate_on_cluster(scheduler, tasks)
        return ((task, task.evaluate()) for task in tasks)

    run(search, evaluate, file, report)
    words = "wrench closure" if problem.closure else _describe(rig, required)
    if clearance is not None:
        words += f", cables {clearance:g} m apart"
    return CertifiedWorkspace(rig, problem.anchors[0], words, cells, *search.found(), search.evaluations)


def _describe(rig: Rig, required: Required) -> str:
    """Return in a few words what is required of a rig."""
    return (rig.required if required is None else as_requirement(required)).describe(rig)
