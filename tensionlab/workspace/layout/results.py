"""Results of a layout search: `Layout`, `LayoutSearch`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tensionlab.model.files import rig_to_toml
from tensionlab.model.rig import Rig
from tensionlab.support.formatting import format_range
from tensionlab.support.table import Column, Table
from tensionlab.workspace.layout.objective import Objective


class Nearest(NamedTuple):
    """Module and body that come closest to each other, relative to the body's margin."""

    module: str
    body: str
    distance: float  # that is proved in all targets, in m
    margin: float  # of the body, in m

    def describe(self) -> str:
        """Return the distance in words."""
        return f"{self.distance:.3f} m ({self.module} and {self.body}; its margin is {self.margin:g} m)"


@dataclass(frozen=True)
class Layout:
    """Rig with modules on the surfaces of a space, and its score.

    Attributes
    ----------
    rig : Rig
        The modules that were placed, in the order of their surfaces, and the fixed ones last.
    score : float
        Score by the objective: a share, a force in N or a stiffness in N/m.
    worst : float
        Force in N that is feasible in every direction everywhere in the target, after any loss that the objective
        counts with; below zero where none is.
    contributions : tuple of float
        For each module, the score lost when it is removed and the others stay: all of it where they render no
        force at all; below zero where they do better without it.
    proved : float or None
        Force in N that is proved feasible in the objective's directions everywhere in the box of a target, or
        along a path, up to that of the objective; NaN where none is, None where no proof was wanted.
    nearest : Nearest or None
        Module and body that come closest; None without bodies.

    Examples
    --------
    >>> import tensionlab as tl
    >>> tl.workspace.Layout(tl.load_rig("floor-3"), score=1.2, worst=1.2, contributions=(1.2, 0.9, 1.1))
    <Layout of floor-3: 3 modules, score 1.2, worst margin 1.2 N>
    """

    rig: Rig
    score: float
    worst: float
    contributions: tuple[float, ...]
    proved: float | None = None
    nearest: Nearest | None = None

    @property
    def clear(self) -> bool:
        """Whether no cable comes closer to a body than its margin, anywhere in the target."""
        return self.nearest is None or self.nearest.distance >= self.nearest.margin

    def __repr__(self) -> str:
        return f"<Layout of {self._title}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self) -> Table:
        """Return the table of the modules, with the score that is lost without each."""
        turns = self.rig.n > self.rig.dimension
        rows = [
            [module.name, module.frame, module.anchor.round(4), *[end.round(4)][:turns], lost]
            for module, end, lost in zip(self.rig.modules, self.rig.attachments, self.contributions, strict=True)
        ]
        ends = [Column("anchor", "m"), Column("attachment", "m")][: 1 + turns]
        return Table(["module", "frame", *ends, "score lost without it"], rows, self._title, self.notes)

    @property
    def _title(self) -> str:
        return f"{self.rig.name}: {self.rig.m} modules, score {self.score:.4g}, worst margin {self.worst:.4g} N"

    @property
    def notes(self) -> list[str]:
        """What is proved everywhere in the target, in words: the clearance, and the force if that was wanted."""
        where = "everywhere in the target" + ", in its rotations" * (self.rig.n > self.rig.dimension)
        notes = []
        if self.nearest is not None:
            clear = "stay away from bodies by" if self.clear else "come too close to a body:"
            notes.append(f"proved {where}: cables {clear} {self.nearest.describe()}")
        if self.proved is not None:
            force = "nothing" if np.isnan(self.proved) else f"{self.proved:.4g} N"
            notes.append(f"proved {where}: {force}")
        return notes

    def to_toml(self) -> str:
        """Return the rig file, with the score and what is proved as comments."""
        return "\n".join([*(f"# {line}" for line in (self._title, *self.notes)), "", rig_to_toml(self.rig)])


@dataclass(frozen=True)
class LayoutSearch:
    """Layouts that a search found, one for each number of modules, the fewest first."""

    objective: Objective
    layouts: tuple[Layout, ...]

    def __repr__(self) -> str:
        counts = format_range([layout.rig.m for layout in self.layouts])
        return f"<LayoutSearch for {counts} modules: the best has {self.best.rig.m}, score {self.best.score:.4g}>"

    def _repr_html_(self) -> str:
        return self.table()._repr_html_() + self.best._repr_html_()

    def table(self) -> Table:
        """Return the table of the layouts, by their number of modules."""
        rows = [[layout.rig.m, layout.score, layout.worst, layout in self.front] for layout in self.layouts]
        columns = ["modules", "score", Column("worst margin", "N"), "better than with fewer"]
        return Table(columns, rows, f"score: {self.describe()}")

    def describe(self) -> str:
        """Return the meaning of the score in words."""
        return self.objective.describe(self.best.rig)

    @property
    def front(self) -> tuple[Layout, ...]:
        """Layouts that no other with as many modules or fewer surpasses."""
        best: list[Layout] = []
        for layout in self.layouts:
            if not best or (layout.clear, layout.score) > (best[-1].clear, best[-1].score):
                best.append(layout)
        return tuple(best)

    @property
    def best(self) -> Layout:
        """Layout with the highest score of those clear of bodies; of equals, the one with the fewest modules."""
        return self.front[-1]
