"""Cells of a region, and what is proved of them: `CertifiedWorkspace`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tensionlab.errors import InputError
from tensionlab.model import pose
from tensionlab.model.rig import Rig
from tensionlab.support import provenance
from tensionlab.support.arrays import Floats, Integers, require_finite
from tensionlab.support.colours import GREY
from tensionlab.support.formatting import format_count, format_share
from tensionlab.support.table import Column, Mark, Table, met_mark

if TYPE_CHECKING:
    import xarray

MARKS = {
    1: met_mark(True, ("inside", "")),
    -1: met_mark(False, ("", "outside")),
    0: Mark("○", GREY, "undecided"),
}  # of each verdict
SUM_ROUNDING = 1e-12  # relative rounding error of sums of volumes
MIN_ROOTS = 4  # first cells along the shortest edge: fewer would make the finest much smaller than needed
MAX_AXIS_CELLS = 2**30  # largest number of cells along one axis; more are taken for a mistaken resolution


class Subdivision(NamedTuple):
    """Box from ``low`` with edges ``extent`` (d,), in m, in cells (roots times 2^level) along each axis.

    A cell is its level and its place along each axis. An axis without extent has one cell, which is never cut.
    """

    low: Floats
    extent: Floats
    roots: Integers
    levels: int

    @property
    def volume(self) -> float:
        """Volume of the box, in m to the power of the number of its axes that have an extent."""
        return float(np.prod(self.extent[self.extent > 0]))

    def edges(self, level: ArrayLike) -> Floats:
        """Return the edges (..., d) of the cells of levels (...), in m."""
        parts = self.roots * 2.0 ** np.asarray(level)[..., None]
        return np.asarray(self.extent / np.where(self.extent > 0, parts, 1))

    def centres(self, level: int, places: Integers) -> Floats:
        """Return the centres (k, d) of cells, in m."""
        return self.low + (places + 0.5) * self.edges(level)

    def cell_volume(self, level: ArrayLike) -> Floats:
        """Return the volume (...) of a cell of levels (...)."""
        return np.asarray(np.prod(self.edges(level)[..., self.extent > 0], axis=-1))

    def first(self) -> Integers:
        """Return the places (k, d) of the cells of the first level."""
        return np.indices(tuple(self.roots.tolist())).reshape(len(self.low), -1).T.astype(np.int64)

    def children(self, places: Integers) -> Integers:
        """Return the places of the cells into which cells are divided."""
        cut = self.extent > 0
        parts = np.array(list(product(*((0, 1) if is_cut else (0,) for is_cut in cut))))
        doubled = places[:, None] * np.where(cut, 2, 1)
        return np.asarray(doubled + parts).reshape(-1, len(self.low))

    def place_of(self, level: int, position: Floats) -> Integers:
        """Return the places (k, d) of the cells that hold positions (k, d) of the box."""
        edges = self.edges(level)
        along = (position - self.low) / np.where(edges > 0, edges, 1.0)
        last = np.where(edges > 0, self.roots * 2**level, 1) - 1
        return np.clip(np.floor(along), 0, last).astype(np.int64)


def subdivide(region: ArrayLike, resolution: ArrayLike, dimension: int) -> Subdivision:
    """Return the cells of a region (d, 2), in m, the finest of which have edges of the resolution at most."""
    ends = require_finite("region", region, 2)
    if ends.shape != (dimension, 2):
        raise InputError(f"region has shape {ends.shape}; give its ends along {'xyz'[:dimension]}, in m")
    low, extent = ends[:, 0], ends[:, 1] - ends[:, 0]
    if not (extent >= 0).all() or not (extent > 0).any():
        axis = int(np.argmin(extent))
        runs = f"from {ends[axis, 0]:g} to {ends[axis, 1]:g} along {'xyz'[axis]}"
        raise InputError(f"region runs {runs}; give the lower end first, and one axis at least an extent")
    steps = require_finite("resolution", resolution, 0)
    if steps.shape not in ((), (dimension,)) or not (steps > 0).all():
        raise InputError(f"resolution is {steps.tolist()}; give one length in m, or one for each axis, above zero")
    counts = np.maximum(1, np.ceil(extent / steps * (1 - 1e-12)))
    if not (counts <= MAX_AXIS_CELLS).all():
        raise InputError(f"resolution is {steps.tolist()}; an axis of the region has {counts.max():.2g} of that")
    levels = max(0, int(np.log2(counts[extent > 0].min() / MIN_ROOTS)))
    roots = np.where(extent > 0, np.ceil(counts / 2**levels), 1).astype(np.int64)
    return Subdivision(low, extent, roots, levels)


class Bounds(NamedTuple):
    """Lower and upper bound of a number."""

    lower: float
    upper: float

    def describe(self, digits: int = 4) -> str:
        """Return both bounds with some significant digits, rounded away from each other."""

        def rounded(value: float, way: Callable[[float], int]) -> str:
            scale = 10.0 ** (digits - 1 - math.floor(math.log10(abs(value)))) if value else 1.0
            return f"{way(value * scale) / scale:.{digits}g}"

        return f"{rounded(self.lower, math.floor)} to {rounded(self.upper, math.ceil)}"


@dataclass(frozen=True, eq=False)
class CertifiedWorkspace:
    """Proof about a region: in which cells every pose renders all that is required, and in which none does.

    Cells are boxes of positions; those that are undecided are of the finest size, unless a gap was given.

    Attributes
    ----------
    rig : Rig
        Rig whose poses were examined.
    anchors : (m, d) array
        Anchors in the world, in m.
    required : str
        What is required, in words.
    subdivision : Subdivision
        The region, and how it is cut into cells.
    level, place : (k,) and (k, d) arrays
        How often the region's first cells were split for each cell, and its index along each axis.
    verdict : (k,) array
        1 inside, -1 outside, 0 undecided.
    shares : (k, 2) array
        Lower bounds of the share of a cell that is inside, and that is outside.
    evaluations : int
        Number of cells that were examined, each once for all rotations.
    losses : dict
        If losses were proved: the proof without each module, by its name.
    """

    rig: Rig
    anchors: Floats
    required: str
    subdivision: Subdivision
    level: NDArray[np.int8]
    place: Integers
    verdict: NDArray[np.int8]
    shares: Floats
    evaluations: int
    losses: Mapping[str, CertifiedWorkspace] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<CertifiedWorkspace of {self._title}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return the table of what is proved inside and outside, and what is undecided."""
        whole = self.region_volume
        every = len(self.verdict)  # all cells are the whole region, whatever the rounding of their sum
        rows = [
            [MARKS[key], cells, volume, 1.0 if cells == every else volume / whole]
            for key, (cells, volume) in self.tally().items()
        ]
        share = Column("share of the region", format=format_share)
        columns = ["proved", "cells", Column("volume", self.unit), share]
        return Table(columns, rows, self._title, [f"required: {self.required}"])

    @property
    def _title(self) -> str:
        cells, whole = format_count(len(self.verdict), "cell"), f"{self.region_volume:.4g} {self.unit}"
        return f"{self.rig.name}: {self.volume.describe()} of {whole} inside, {cells}"

    @property
    def proved(self) -> bool:
        """Whether the whole region is inside."""
        return bool((self.verdict == 1).all())

    @property
    def unit(self) -> str:
        """Unit of volumes: m³ in space, m² in the plane or a plane of it."""
        return "m" + ("", "²", "³")[int((self.subdivision.extent > 0).sum()) - 1]

    @property
    def region_volume(self) -> float:
        """Volume of the region."""
        return self.subdivision.volume

    @property
    def cell_volumes(self) -> Floats:
        """Volume of each cell, (k,)."""
        return self.subdivision.cell_volume(self.level)

    @property
    def volume(self) -> Bounds:
        """Bounds of the volume in which every pose renders all that is required."""
        inside, outside = (self.cell_volumes[:, None] * self.shares).sum(axis=0)
        upper = min(self.region_volume, (self.region_volume - outside) + SUM_ROUNDING * self.region_volume)
        return Bounds(float(inside) * (1 - SUM_ROUNDING), float(upper))

    @property
    def share(self) -> Bounds:
        """Bounds of the same volume as a share of the region."""
        low, high = self.volume
        return Bounds(low / self.region_volume * (1 - SUM_ROUNDING), min(1.0, high / self.region_volume))

    @property
    def worst_loss(self) -> str:
        """Name of the module whose loss leaves the smallest volume, by the upper bounds."""
        return min(self.losses, key=lambda name: round(self.losses[name].volume.upper, 9), default="")

    def losses_table(self) -> Table:
        """Return the bounds of the volume after the loss of each module."""
        columns = ["lost module", Column("volume inside", self.unit), Column("share of the region", "%")]
        rows = [
            [name, proof.volume.describe(), Bounds(*(100 * bound for bound in proof.share)).describe()]
            for name, proof in self.losses.items()
        ]
        return Table(columns, rows, f"After the loss of one module; the worst is {self.worst_loss}")

    def tally(self) -> dict[int, tuple[int, float]]:
        """Return the number and the volume of the cells of each verdict: 1 inside, -1 outside, 0 undecided."""
        chosen = {verdict: self.verdict == verdict for verdict in MARKS}
        return {key: (int(mask.sum()), float(self.cell_volumes[mask].sum())) for key, mask in chosen.items()}

    @property
    def edges(self) -> Floats:
        """Edges of each cell, (k, d), in m."""
        return self.subdivision.edges(self.level)

    @property
    def centres(self) -> Floats:
        """Centre of each cell, (k, d), in m."""
        return self.subdivision.low + (self.place + 0.5) * self.edges

    def at(self, position: ArrayLike) -> NDArray[np.int8]:
        """Return what is proved at positions (..., d), in m: 1 inside, -1 outside, 0 undecided or elsewhere."""
        given = pose.points(position, self.rig.dimension, "position")
        cell = self._cell_of(given.reshape(-1, self.rig.dimension))
        return np.where(cell < 0, 0, self.verdict[cell]).astype(np.int8).reshape(given.shape[:-1])[()]

    def _cell_of(self, points: Floats) -> Integers:
        """Return the numbers (k,) of the cells that hold points (k, d); -1 for points outside the region."""
        cells, indices = self.subdivision, np.full(len(points), -1)
        within = np.flatnonzero(((points >= cells.low) & (points <= cells.low + cells.extent)).all(axis=1))
        for level in map(int, np.unique(self.level)):
            own = np.flatnonzero(self.level == level)
            size = tuple(np.where(cells.extent > 0, cells.roots * 2**level, 1))
            keys = np.ravel_multi_index(tuple(self.place[own].T), size)
            wanted = np.ravel_multi_index(tuple(cells.place_of(level, points[within]).T), size)
            order = np.argsort(keys)
            where = order[np.searchsorted(keys, wanted, sorter=order).clip(max=len(own) - 1)]
            there = keys[where] == wanted
            indices[within[there]] = own[where[there]]
        return indices

    def to_xarray(self) -> xarray.Dataset:
        """Return a row for each cell: its verdict, the shares proved inside and outside, its centre and edges."""
        data: xarray.Dataset = provenance.import_xarray().Dataset(
            {
                "verdict": ("cell", self.verdict, {"long_name": "1 inside, -1 outside, 0 undecided"}),
                "share_inside": ("cell", self.shares[:, 0], {"long_name": "share inside, at least"}),
                "share_outside": ("cell", self.shares[:, 1], {"long_name": "share outside, at least"}),
                "centre": (("cell", "axis"), self.centres, {"units": "m", "long_name": "centre of the cell"}),
                "edge": (("cell", "axis"), self.edges, {"units": "m", "long_name": "edges of the cell"}),
            },
            coords={"axis": list("xyz"[: self.rig.dimension])},
            attrs={
                "title": f"tensionlab certified workspace: {self.rig.name}",
                "required": self.required,
                "volume_lower": self.volume.lower,
                "volume_upper": self.volume.upper,
                "region_volume": self.region_volume,
                "volume_unit": self.unit,
                "evaluations": self.evaluations,
            },
        )
        return data


def intersection(losses: Mapping[str, CertifiedWorkspace], required: str) -> CertifiedWorkspace:
    """Return what is proved for any one loss, from the proofs of a region after each.

    Its cells are the smallest of all proofs: inside if they are inside after every loss, outside if they are so
    after one. The share of a cell that is not proved inside is at most the sum of those after each loss.
    """
    proofs = list(losses.values())
    cells = proofs[0].subdivision
    every = np.unique(np.vstack([np.column_stack([proof.level, proof.place]) for proof in proofs]), axis=0)
    level, place = every[:, 0], every[:, 1:]
    centres = cells.low + (place + 0.5) * cells.edges(level)
    own = [proof._cell_of(centres) for proof in proofs]
    smallest = np.all([proof.level[cell] <= level for proof, cell in zip(proofs, own, strict=True)], axis=0)
    verdicts = [proof.verdict[cell[smallest]] for proof, cell in zip(proofs, own, strict=True)]
    shares = np.stack([proof.shares[cell[smallest]] for proof, cell in zip(proofs, own, strict=True)])
    inside = np.maximum(1 - (1 - shares[..., 0]).sum(axis=0), 0.0)
    return replace(
        proofs[0],
        required=required,
        level=level[smallest].astype(np.int8),
        place=place[smallest],
        verdict=np.min(verdicts, axis=0),
        shares=np.column_stack([inside, shares[..., 1].max(axis=0)]),
        evaluations=sum(proof.evaluations for proof in proofs),
        losses=losses,
    )
