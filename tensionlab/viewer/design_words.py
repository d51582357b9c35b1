"""Texts of the design page as HTML: status, forces, margin, tensions, workspace and solvers."""

from __future__ import annotations

import numpy as np

from tensionlab.solvers.base import Status
from tensionlab.support.colours import GREEN, RED
from tensionlab.support.table import STATUS_MARKS
from tensionlab.viewer.evaluation import StateEvaluation
from tensionlab.viewer.html import norm, number, render, vector
from tensionlab.viewer.scene import force_scale, tension_colours
from tensionlab.viewer.state import DesignState
from tensionlab.viewer.volume import Volume
from tensionlab.workspace.layout.task import LayoutTask
from tensionlab.workspace.metrics import find_metric
from tensionlab.workspace.volume import describe_step

POLICY_WORDS = {
    "force": "the nearest wrench is rendered",
    "tension": "the tensions nearest to equilibrium are taken",
    "direction": "the longest wrench in the desired direction is rendered",
}  # meaning of each policy where the desired wrench is infeasible
AT_LIMIT_N = 1e-6


def status(state: DesignState, found: StateEvaluation) -> str:
    """Return the status, the forces and the margin."""
    if found.allocation is None:
        return render("design.status", RED, "no answer", found.problem, [], 0.0)
    word, colour, meaning = "EXACT", GREEN, "the desired force is rendered"
    code = Status(int(found.allocation.status))
    if code is Status.NEAREST:
        word, colour = "NEAREST", RED
        meaning = "certified infeasible: " + POLICY_WORDS.get(str(found.policy), "another wrench is rendered")
        if found.policy == "direction" and np.isfinite(found.allocation.scale):
            meaning += f", {100 * float(found.allocation.scale):.3g} % of it"
    elif code is not Status.EXACT:
        word, colour, meaning = code.name, RED, STATUS_MARKS[code].word
    return render("design.status", colour, word, meaning, _lines(state, found), 1.0 / force_scale(state.rig))


def _lines(state: DesignState, found: StateEvaluation) -> list[tuple[str, str, str]]:
    """Return name, value and remark of each line about the wrench and the margin."""
    assert found.allocation is not None
    assert found.rendered is not None
    d, has_torque = state.rig.dimension, state.rig.n > state.rig.dimension
    lines = []
    for name, part, unit in (("force", slice(0, d), "N"), ("torque", slice(d, None), "N·m"))[: 1 + has_torque]:
        for which, wrench in (("desired", state.wrench), ("rendered", found.rendered)):
            lines.append((f"{which} {name}", f"{norm(wrench[part])} {unit}", vector(wrench[part])))
    remark = "N and N·m together" if has_torque else ""
    lines.append(("error", f"{number(float(found.allocation.residual))} N", remark))
    if found.certificate is not None:
        proof = f"along {vector(found.certificate.direction)}; desired {number(found.certificate.desired)} N"
        lines.append(("at most", f"{number(found.certificate.reach)} N", proof))
    lines.append(("capacity margin", f"{found.margin:.3g} N", "at the hand"))
    return lines


def tensions(state: DesignState, found: StateEvaluation) -> str:
    """Return each module's tension as a bar between zero and the largest limit."""
    if found.allocation is None:
        return ""
    most, colours = float(state.rig.limits.upper.max()) or 1.0, tension_colours(state.rig, found)
    lines = []
    for module, tension, colour in zip(state.rig.modules, found.allocation.tensions, colours, strict=True):
        limit = "lower limit" if tension <= module.lower + AT_LIMIT_N else ""
        limit = "upper limit" if tension >= module.upper - AT_LIMIT_N else limit
        lines.append((module, float(tension), colour, limit))
    return render("design.tensions", lines, most)


def share(state: DesignState, volume: Volume, ghost: Volume | None = None) -> str:
    """Return the share of the box in which the metric is above the level."""
    metric = find_metric(state.metric)
    return render(
        "design.share",
        metric.title,
        "" if metric.unit == "1" else f" {metric.unit}",
        metric.description,
        volume,
        state.level,
        describe_step(volume.axes),
        ghost,
    )


def space(task: LayoutTask | None) -> str:
    """Return what walls a space file has."""
    if task is None:
        return render("common.note", "With a space, anchors that are dragged stay on its walls.")
    return render("common.note", f"{task.name}: {', '.join(surface.name for surface in task.space.surfaces)}")
