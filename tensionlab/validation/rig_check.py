"""Checks of a rig before anything is built: rank, limits, balance and strength at home, and after a loss."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tensionlab.allocation import allocate
from tensionlab.haptics.rendering.brakes import ImpactCap, brake_strengths
from tensionlab.model import directions, wall_stiffness
from tensionlab.model.module import KINDS
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.solvers.base import RANK_TOLERANCE, Status
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_share
from tensionlab.support.table import Column, Finding, Table
from tensionlab.workspace.interference import body_distances
from tensionlab.workspace.structure_metrics import feasibility_tolerance, feasible_direction_fraction
from tensionlab.workspace.wrench_set import facet_distance, half_spaces, loss_margins, required_margin

MAX_TENSION_RATIO = 1e4  # tensions that balance only with a larger ratio between cables do not count
LIKELY_LENGTHS_M = (0.01, 100.0)  # of the longest cable; only stadium cameras and telescopes have longer ones
HEAD_FORCE_N = ImpactCap().force  # largest force of all cables together on a head
LOSS_DIRECTIONS = 200  # directions of 1 N, or 1 N·m, that are tried after a loss


def check_rig(rig: Rig) -> list[Finding]:
    """Check whether a rig can work at its home, with body frames at rest."""
    structure = rig.structure_matrix(rig.home, frames=rig.at_rest)
    findings = [_rank(structure), _limits(rig), *_scale(rig)]
    held = False
    if rig.weight is not None:
        findings.append(_weight(rig, structure))
        held = findings[-1].passed is True
    met = True
    if rig.required:
        findings.append(_required(rig, structure))
        met = findings[-1].passed is True
    balanced = _is_balanced(rig, structure)
    findings.append(_balance(structure, balanced, held or (met and bool(rig.required))))
    if met and (balanced or held or rig.required):
        findings.append(_strength(rig, structure, _load(rig, balanced)))
    if not KINDS[rig.kind].has_orientation:
        findings.append(_walls(rig, structure))
    if rig.bodies:
        findings.append(_bodies(rig))
    if rig.frames:
        names = ", ".join(rig.frames)
        findings.append(Finding("frames", None, f"{names}: must be given at run time; at rest for this check"))
    return findings


class ModuleLoss(NamedTuple):
    """What is left at home after the loss of a module."""

    module: str
    margin: float  # capacity margin about the load, in N
    holds: bool  # whether the others render the load within their limits
    directions: float  # share of directions in which 1 N (or 1 N·m) is feasible in addition


def check_losses(rig: Rig) -> list[ModuleLoss]:
    """Return what the others render after the loss of each module, whose cable then has no tension.

    At home, with body frames at rest, of what is required of the rig, or of its weight where that closes the
    wrench set. Nothing for one module alone.
    """
    if rig.m == 1:
        return []
    structure = rig.structure_matrix(rig.home, frames=rig.at_rest)
    load = _load(rig, _is_balanced(rig, structure))
    margins = required_margin(rig, structure, load, margin=loss_margins)
    forces = directions.fibonacci(LOSS_DIRECTIONS) if rig.dimension == 3 else directions.circle(LOSS_DIRECTIONS)
    remaining = ~np.eye(rig.m, dtype=bool)
    limits = (rig.limits.lower * remaining, rig.limits.upper * remaining)
    shares = feasible_direction_fraction(structure, limits, forces, 1.0, load.middle(rig))
    holds = margins >= -feasibility_tolerance(load.at(rig))
    names = (module.name for module in rig.modules)
    return list(map(ModuleLoss, names, margins.tolist(), holds.tolist(), shares.tolist()))


def losses_table(rig: Rig, losses: list[ModuleLoss]) -> Table:
    """Return the table of what is left after each loss, and what a run does then."""
    unit = KINDS[rig.kind].force_unit
    columns = ["lost module", Column("margin left", unit, ".3g"), "holds",
               Column(f"directions with 1 {unit}", format=format_share), "run --on-loss continue"]  # fmt: skip
    rows = [
        [loss.module, loss.margin, loss.holds, loss.directions,
         "holds with the others" if loss.holds else f"falls short by {-loss.margin:.3g} {unit} or more"]
        for loss in losses
    ]  # fmt: skip
    load = _load(rig, _is_balanced(rig, rig.structure_matrix(rig.home, frames=rig.at_rest)))
    held = f"render {load.describe(rig)}" if load else "hold each other"
    notes = [
        f"holds: the other cables {held} within their limits; the lost one has no tension",
        f"directions with 1 {unit}: share of {LOSS_DIRECTIONS} directions in which they render that in addition",
        "run --on-loss stop, the default, stops all modules and releases their cables: support what hangs",
    ]
    if rig.n > rig.dimension:
        notes.append(f"margins: torques count as forces at {rig.required.length_for(rig):.3g} m")
    return Table(columns, rows, f"{rig.name} at home after the loss of a module", notes)


def _is_balanced(rig: Rig, structure: Floats) -> bool:
    """Whether tensions within the limits hold each other."""
    return bool(allocate(structure, np.zeros(rig.n), rig.limits).status == Status.EXACT)


def _load(rig: Rig, balanced: bool) -> Requirement:
    """Return what is required of a rig or, where only weight can close the wrench set, its weight."""
    return rig.required if rig.required or balanced or rig.weight is None else Requirement(gravity=True)


def _rank(structure: Floats) -> Finding:
    """Check that the cables can pull in every direction of motion, one way or the other."""
    n, m = structure.shape
    rank = int(np.linalg.matrix_rank(structure, rtol=RANK_TOLERANCE))
    if rank == n:
        return Finding("rank", True, f"{rank} of {n} components with {m} cables")
    why = f"{m} cables are fewer than {n} components" if m < n else "cables are parallel or in one plane"
    return Finding("rank", False, f"only {rank} of {n} components: {why}; add or move modules")


def _scale(rig: Rig) -> list[Finding]:
    """Note that the unit of coordinates may be wrong, where cables are very long or very short."""
    longest = float(rig.lengths(rig.home, frames=rig.at_rest).max())
    if LIKELY_LENGTHS_M[0] <= longest <= LIKELY_LENGTHS_M[1]:
        return []
    advice = "mm, divide" if longest > LIKELY_LENGTHS_M[1] else "km, multiply"
    text = f"the longest cable has {longest:.4g} m at home: if its coordinates are in {advice} them by 1000"
    return [Finding("scale", None, text)]


def _limits(rig: Rig) -> Finding:
    """Check that the limits leave every cable room."""
    lower, upper = rig.limits.lower, rig.limits.upper
    stuck = [module.name for module in rig.modules if module.lower == module.upper]
    if stuck:
        return Finding("limits", None, f"no choice of tension in {', '.join(stuck)}: lower equals upper")
    text = f"{lower.min():g} N and more, {upper.max():g} N and less, upper > lower in all"
    strongest = float((upper + brake_strengths(rig)).sum())
    heads = any("head" in name.lower() for body in rig.bodies for name in (body.name, body.frame))
    if heads and strongest > HEAD_FORCE_N and any(module.brake for module in rig.modules):
        text += (
            f"; with brakes {strongest:g} N together, so not for a head, which allows {HEAD_FORCE_N:g} N: "
            "scenarios with a head refuse this rig until breakaway links make `brake` less"
        )
    return Finding("limits", True, text)


def _weight(rig: Rig, structure: Floats) -> Finding:
    """Check that the cables can hold the platform's weight at home."""
    assert rig.platform is not None
    assert rig.weight is not None
    allocation = allocate(structure, -rig.weight, rig.limits)
    if allocation.status == Status.EXACT:
        tensions = f"{allocation.tensions.min():.3g} to {allocation.tensions.max():.3g} N"
        return Finding("weight", True, f"{rig.platform.mass:g} kg are held at home, with tensions of {tensions}")
    text = f"{rig.platform.mass:g} kg cannot be held at home within the limits: move modules or widen the limits"
    return Finding("weight", False, text)


def _required(rig: Rig, structure: Floats) -> Finding:
    """Check that the cables can exert all that is required of the rig at home."""
    margin = float(required_margin(rig, structure, rig.required))
    arm = f" (torques at {rig.characteristic_length:.3g} m)" if rig.n > rig.dimension else ""
    what, unit = rig.required.describe(rig), KINDS[rig.kind].force_unit
    if margin >= -feasibility_tolerance(rig.required.at(rig)):
        return Finding("required", True, f"{what}: feasible, {max(margin, 0.0):.3g} {unit} from the edge{arm}")
    text = f"{what}: infeasible by {-margin:.3g} {unit}{arm}: move modules, widen the limits or require less"
    return Finding("required", False, text)


def _balance(structure: Floats, balanced: bool, held: bool) -> Finding:
    """Check that the cables can balance with no outside force; not needed where weight pulls."""
    if balanced:
        return Finding("balance", True, "the cables hold each other at home, within their limits")
    n, m = structure.shape
    ratio = (np.ones(m), np.full(m, MAX_TENSION_RATIO))
    if allocate(structure, np.zeros(n), ratio).status == Status.EXACT:
        text = "the cables could hold each other, but not within their limits: widen the limits"
    else:
        text = "no tensions hold each other at home (no wrench closure): weight must pull, or add a module"
    return Finding("balance", None if held else False, text)


def _strength(rig: Rig, structure: Floats, offset: Requirement) -> Finding:
    """Check the force and the torque that the rig renders in its weakest direction, in addition to the offset."""
    normals, offsets = half_spaces(structure, rig.limits)
    distances = offsets - normals @ offset.middle(rig)
    forces = directions.grid18() if rig.dimension == 3 else directions.circle()
    strength = facet_distance(distances, normals[:, : rig.dimension], forces).clip(min=0.0)
    weakest = int(np.argmax(strength <= strength.min() * (1 + 1e-9)))  # the first of those equal but for rounding
    where = ", ".join(f"{part:.2f}" for part in forces[weakest].round(2) + 0.0)
    unit = KINDS[rig.kind].force_unit
    text = f"{strength[weakest]:.3g} {unit} in its weakest of {len(forces)} directions, ({where})"
    text += f"; {strength.max():.3g} {unit} in its strongest"
    if rig.n > rig.dimension:
        torques = directions.grid18() if rig.dimension == 3 else np.array([[1.0], [-1.0]])
        twist = facet_distance(distances, normals[:, rig.dimension :], torques).clip(min=0.0)
        text += f"; torque {twist.min():.3g} to {twist.max():.3g} N·m"
    if offset:
        text += f"; in addition to {offset.describe(rig)}"
    return Finding("strength", bool(strength[weakest] > 0), text)


def _walls(rig: Rig, structure: Floats) -> Finding:
    """Note how stiff a wall may be along each axis: a module along it renders it, elsewhere the host."""
    host = f"{wall_stiffness.host_stiffness():.0f} N/m by the host"
    loop = f"{1.0 / wall_stiffness.CYCLE_S:g} cycles/s, {1e3 * wall_stiffness.LATENCY_S:g} ms late"
    names = [f"{sign}{axis}" for sign in "+-" for axis in "xyz"[: rig.dimension]]
    axes = np.eye(rig.dimension)
    stiffnesses = wall_stiffness.module_stiffness(structure.T, np.concatenate([axes, -axes]))
    modules = [
        f"{stiffness:.0f} N/m towards {name}"
        for name, stiffness in sorted(zip(names, stiffnesses, strict=True), key=lambda pair: pair[0][1:])
        if stiffness >= wall_stiffness.LEAST_MODULE_STIFFNESS
    ]
    if not modules:
        return Finding("walls", True, f"as stiff as {host} ({loop}): no cable is along an axis")
    elsewhere = "" if len(modules) == 2 * rig.dimension else f", elsewhere {host} ({loop})"
    return Finding("walls", True, f"as stiff as {', '.join(modules)} by a module{elsewhere}")


def _bodies(rig: Rig) -> Finding:
    """Check that the cables keep the margin of every body at home."""
    distances = body_distances(rig, rig.home, frames=rig.at_rest)
    texts: list[str] = []
    for index in np.argsort(distances.min(axis=0) - [body.margin for body in rig.bodies]):
        body, distance = rig.bodies[index], float(distances[:, index].min())
        name = rig.modules[distances[:, index].argmin()].name
        sway = f", when that sways by {body.sway:g} m" if body.sway else ""
        how = f"is {distance:.3f} m from {body.name}{sway} (margin {body.margin:g} m)"
        if not texts or distance < body.margin:
            texts.append(f"{name} {how if distance > 0.0 else f'touches {body.name}{sway}'}")
    close = bool((distances < [body.margin for body in rig.bodies]).any())
    text = f"the cable of {'; of '.join(texts)}" + ": move modules or bodies" * close
    return Finding("bodies", not close, text)
