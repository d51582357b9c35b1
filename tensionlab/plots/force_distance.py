"""Force against distance, where a scenario has a surface or a string: there, time does not show the feel."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tensionlab.arrays import Floats
from tensionlab.plots.scale import two_scales
from tensionlab.plots.scene import held_name, plane_of
from tensionlab.plots.style import BLUE
from tensionlab.scenarios.expected_values import ForceRecord, rendered_force

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from tensionlab.scenarios.play import ScenarioResult

SETTLED = 0.3
"""What is felt within so many s of a phase's begin is the modules coming up, or what was before."""
NEAR = 0.12
"""So far from a surface, in m, its force is drawn."""


class Course(NamedTuple):
    """How did a force go with distance? In m and N, each (K,)."""

    distance: Floats
    force: Floats


class Against(NamedTuple):
    """What was meant and what was felt against distance, in a phase?"""

    title: str
    distance: str
    meant: Course
    felt: Course


def against(played: ScenarioResult) -> list[Against]:
    """For which phases does a picture of force against distance make sense, and what is in it?

    Those with a flat surface that pushes or pulls: the force out of it, against the height above it. And those of
    a scenario that is seen from a body, as a bow: the pull towards it, against the distance from it.
    """
    run, frame = played.run, played.scenario.seen_from
    felt, told = rendered_force(played), rendered_force(replace(played, person=None))
    meant = ForceRecord(run.time, told.position, run.desired)
    between = f"from {played.scenario.labels.get(frame or '', frame)} to {held_name(played.scenario)} (m)"
    found = []
    for phase in played.scenario.phases:
        plane = plane_of(phase, ["plane"])
        if plane is None and (frame is None or not phase.effects):
            continue
        courses = [_course(each.during(phase.begin + SETTLED, phase.end), plane) for each in (meant, felt)]
        name = between if plane is None else "height above the surface (mm)"
        found.append(Against(phase.name, name, *courses))
    return found


def draw_against(axes: Axes, each: Against, knee: float) -> None:
    """Draw what was meant, wide and pale, and what was felt."""
    axes.plot(*each.meant, color=BLUE, linewidth=5.0, alpha=0.3)
    axes.plot(*each.felt, color=BLUE, linewidth=1.2)
    axes.grid()
    two_scales(axes, np.concatenate([each.meant.force, each.felt.force]), knee)
    axes.set_xlabel(each.distance)
    axes.set_ylabel("force (N)")
    axes.set_title(each.title)


def _course(part: ForceRecord, plane: Any) -> Course:
    arm, force = part.position, part.force
    if plane is None:
        distance = np.linalg.norm(arm, axis=1)
        towards = -arm / np.where(distance > 0.0, distance, 1.0)[:, None]
        return Course(distance, np.einsum("kd,kd->k", force, towards))
    height = plane.height(arm)
    near = np.abs(height) <= NEAR
    return Course(1e3 * height[near], force[near] @ plane.n)
