"""What a search for layouts has found: `Layout` and `LayoutSearch`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.model.files import rig_to_toml
from tensionlab.model.module import Module, TensionLimits
from tensionlab.model.rig import Rig
from tensionlab.workspace.layout import place
from tensionlab.workspace.layout.objective import Objective
from tensionlab.workspace.layout.place import Places
from tensionlab.workspace.layout.space import Space


@dataclass(frozen=True)
class Layout:
    """Where do the modules stand, and how good is that?

    Attributes
    ----------
    rig : Rig
        With the modules that were put, in the order of their surfaces, and the fixed ones last.
    score : float
        What the objective asked for: a share, or a margin in N.
    worst : float
        The largest force that can be rendered in every direction everywhere in the target, in N; negative where
        not even the force zero can.
    contributions : tuple of float
        For each module, the score lost when it is taken away and the others stay: all of it, and never more, where
        they render no force at all. Below zero where they do better without it.
    """

    rig: Rig
    score: float
    worst: float
    contributions: tuple[float, ...]

    def to_toml(self) -> str:
        """Write the rig file, with the score and the contributions as comments."""
        lines = [f"# Score {self.score:.6g}, worst margin {self.worst:.6g} N. Score lost without each module:"]
        for module, lost in zip(self.rig.modules, self.contributions, strict=True):
            lines.append(f"#   {module.name}: {lost:.6g}")
        return "\n".join([*lines, "", rig_to_toml(self.rig)])


@dataclass(frozen=True)
class LayoutSearch:
    """Which layouts were found, one for each number of modules?

    Attributes
    ----------
    objective : Objective
    layouts : tuple of Layout
        The fewest modules first.
    """

    objective: Objective
    layouts: tuple[Layout, ...]

    @property
    def front(self) -> tuple[Layout, ...]:
        """Layouts that no other beats with as many modules or fewer: what each further module buys."""
        best: list[Layout] = []
        for layout in self.layouts:
            if not best or layout.score > best[-1].score:
                best.append(layout)
        return tuple(best)

    @property
    def best(self) -> Layout:
        """The layout with the highest score; of equals, the one with the fewest modules."""
        return self.front[-1]


def judge(space: Space, target: Floats, objective: Objective, places: Places, name: str) -> Layout:
    """Which rig is a layout, what does it score, and what does each module add to that?"""
    order = np.lexsort((*places.along.T[::-1], places.surfaces))
    places = Places(places.surfaces[order], places.along[order])
    modules = (*_modules(space, places), *space.fixed)
    limits = place.limits(space, len(places.surfaces))
    anchors = place.anchors(space, places)
    margins = place.margins(anchors, limits, target)
    score = float(objective.score(margins))
    lost = []
    for index in range(len(modules)):
        rest = np.arange(len(modules)) != index
        fewer = TensionLimits(limits.lower[rest], limits.upper[rest]) if rest.any() else None
        without = 0.0 if fewer is None else float(objective.score(place.margins(anchors[rest], fewer, target)))
        lost.append(max(score, 0.0) - max(without, 0.0))  # no force is less than none
    rig = Rig(
        name=name,
        kind="point" if space.dimension == 3 else "planar-point",
        modules=modules,
        home=target.mean(axis=0),
        description=f"A layout found by search: {score:.4g} is {objective.describe()}.",
        source="tensionlab layout search",
    )
    return Layout(rig, score, float(margins.min()), tuple(lost))


def _modules(space: Space, places: Places) -> list[Module]:
    """Modules with names after their surfaces, in the axes of their own frames."""
    modules: list[Module] = []
    taken = {module.name for module in space.fixed}
    for index, along in zip(places.surfaces, places.along, strict=True):
        surface = space.surfaces[index]
        number = 1
        while f"{surface.name} {number}" in taken:
            number += 1
        taken.add(f"{surface.name} {number}")
        anchor = surface.corner + along[: len(surface.edges)] @ surface.edges
        modules.append(Module(f"{surface.name} {number}", anchor, *space.limits, frame=surface.frame))
    return modules
