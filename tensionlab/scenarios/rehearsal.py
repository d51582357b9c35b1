"""Rehearsal of a scenario: whether its rig has the reach, forces and brakes that it needs.

The simulated person follows the script on ideal cables, which render every desired force, and ideal brakes. At
each pose on its path, the desired force is allocated on the rig.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tensionlab.allocation import Status, allocate
from tensionlab.haptics.effects import Vibration
from tensionlab.haptics.effects.effect import Memory, Motion
from tensionlab.haptics.rendering.brakes import brake_strengths, choose_locks
from tensionlab.model.wall_stiffness import MIN_COSINE
from tensionlab.scenarios.demand_source import body_origin
from tensionlab.scenarios.person import Person
from tensionlab.scenarios.scenario import BrakeTarget, Phase, Scenario
from tensionlab.support.arrays import Floats, Integers
from tensionlab.support.formatting import format_count, format_range, format_share, format_vector
from tensionlab.support.table import Finding

STOP_STIFFNESS_N_M, STOP_DAMPING_N_S_M = 5000.0, 50.0  # ideal brakes
MIN_FORCE_N = 0.5  # smaller desired forces are not checked
MAX_MISSING = 0.07  # share of a desired force that may be missing: the just noticeable difference


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """Cycles of a rehearsal."""

    time: Floats  # (K,), in s
    position: Floats  # in the world, (K, d), in m
    seen: Floats  # position in the frame of the effects, (K, d), in m
    structure: Floats  # structure matrices, (K, n, m)
    lengths: Floats  # of the cables, (K, m), in m
    desired: Floats  # forces, (K, n), in N


def rehearse(scenario: Scenario) -> Rehearsal:
    """Play a scenario with its simulated person on ideal cables and brakes."""
    person, step = Person(scenario.person, scenario.rig), 1.0 / scenario.rate
    person.begin()
    memories: dict[str, Memory] = {}
    rows = []
    last = None
    for time in step * np.arange(max(round(scenario.seconds * scenario.rate), 1)):
        pose, cables = person(time), person.cables
        origin = body_origin(pose, scenario.frame)
        speed = np.zeros_like(origin) if last is None else (origin - last) / step
        last = origin
        motion = Motion(pose.position - origin, person.velocity - speed, float(time), step)
        desired = np.zeros(scenario.rig.n)
        stop = desired
        for phase in scenario.active_phases(time):
            for name, effect in phase.effects.items():
                force, memories[name], _ = effect.render(motion, memories.get(name))
                desired = desired + force
            if phase.hold is not None:
                stop = _stop(phase.hold, motion)
        rows.append((time, pose.position, motion.position, cables.directions.T, cables.lengths, desired))
        person.apply_force(desired + stop)
    return Rehearsal(*(np.array(column) for column in zip(*rows, strict=True)))


def _stop(target: BrakeTarget, motion: Motion) -> Floats:
    """Return the force of ideal brakes, (d,) in N, on a hand in their wall."""
    wall = target.wall(motion.position)
    normal = np.asarray(wall.normal)
    push = STOP_STIFFNESS_N_M * max(-wall.distance, 0.0)
    if push > 0.0:
        push += STOP_DAMPING_N_S_M * max(-float(normal @ motion.velocity), 0.0)
    return min(push, wall.force) * normal


def check_needs(scenario: Scenario) -> list[Finding]:
    """Check whether a scenario's rig has the reach, the forces of each phase, and the brakes.

    A finding fails if the rig renders nothing of what is needed, and is a note if it renders a part. RigError if
    the hand of the ``scenario`` reaches an anchor.
    """
    played = rehearse(scenario)
    findings = [_reach(scenario, played)]
    for phase in scenario.phases:
        during = np.flatnonzero((played.time >= phase.begin) & (played.time < phase.end))
        if phase.effects:
            findings.append(_force(scenario, phase, played, during))
        unknown = [module.name for module in scenario.rig.modules if module.vibration_gain is None]
        for name, effect in phase.effects.items():
            if isinstance(effect, Vibration) and unknown:
                text = (
                    f"{', '.join(unknown)}: vibration_gain is not known, so its amplitude may differ; measure it: "
                )
                findings.append(Finding(f"{phase.name}: {name}", None, f"{text}tensionlab characterise"))
        if phase.hold is not None:
            findings.append(_brakes(scenario, phase, phase.hold, played, during))
    return findings


def _reach(scenario: Scenario, played: Rehearsal) -> Finding:
    """Check that the cables hold the hand inside their limits on its whole path."""
    rig = scenario.rig
    low, high = played.position.min(axis=0).round(2) + 0.0, played.position.max(axis=0).round(2) + 0.0
    text = f"{format_vector(low)} to {format_vector(high)} m, cables of {format_range(played.lengths.round(2))} m"
    if rig.m <= rig.n:
        return Finding("reach", None, f"{text}; {format_count(rig.m, 'cable')} cannot pull in all directions")
    nothing, home = rig.required.middle(rig), rig.structure_matrix(rig.home, frames=rig.at_rest)
    held = allocate(played.structure, nothing, rig.limits).status == Status.EXACT
    if held.all():
        return Finding("reach", True, text)
    if not held.any() and allocate(home, nothing, rig.limits).status != Status.EXACT:
        return Finding("reach", None, f"{text}; not all directions, nor at the rig's home")
    first = int(np.argmin(held))
    text += (
        f"; the cables hold the hand {format_share(float(held.mean()))} of the time, not at "
        f"{played.time[first]:.2f} s, {format_vector(played.position[first].round(2) + 0.0)} m"
    )
    return Finding("reach", None if held.any() else False, text)


def _force(scenario: Scenario, phase: Phase, played: Rehearsal, during: Integers) -> Finding:
    """Check the forces of a phase's effects."""
    sizes = np.linalg.norm(played.desired[during], axis=1)
    strong = during[sizes > MIN_FORCE_N]
    if not strong.size:
        return Finding(phase.name, True, f"no force above {MIN_FORCE_N:g} N is desired")
    desired, sizes = played.desired[strong], sizes[sizes > MIN_FORCE_N]
    required = scenario.rig.required.middle(scenario.rig)
    allocation = allocate(
        played.structure[strong], desired + required, scenario.rig.limits, policy=scenario.policy
    )
    rendered = allocation.wrench - required
    missing = np.linalg.norm(desired - rendered, axis=1) / sizes
    feasible = missing <= MAX_MISSING
    text = f"up to {sizes.max():.1f} N are desired, and feasible"
    if feasible.all():
        return Finding(phase.name, True, text)
    along = np.einsum("kn,kn->k", desired, rendered) / sizes
    some = along > MIN_COSINE * np.linalg.norm(rendered, axis=1)
    worst = int(np.argmax(missing * sizes))
    direction = format_vector((desired[worst] / sizes[worst]).round(2) + 0.0)
    text += (
        f" {format_share(float(feasible.mean()))} of the time; at {played.time[strong[worst]]:.2f} s, "
        f"{along[worst]:.1f} N are rendered where {sizes[worst]:.1f} N are desired along {direction}"
    )
    return Finding(phase.name, None if some.any() else False, text)


def _brakes(scenario: Scenario, phase: Phase, target: BrakeTarget, played: Rehearsal, during: Integers) -> Finding:
    """Check the force that brakes and motors hold where the hand is stopped."""
    rig, name = scenario.rig, f"{phase.name}: brakes"
    walls = [target.wall(position) for position in played.seen[during]]
    touched = [index for index, wall in enumerate(walls) if wall.distance <= 0.0]
    if not touched:
        return Finding(name, True, "the hand does not come to where they hold")
    strengths = brake_strengths(rig)
    if target.cap is not None:
        strengths = np.minimum(strengths, target.cap.force)
    structure, normals = played.structure[during[touched]], np.array([walls[index].normal for index in touched])
    chosen = choose_locks(structure, normals, target.force, rig.limits, strengths)
    held = target.force - float(chosen.unresisted.max())
    text = f"{max(held, 0.0):.0f} N of {target.force:g} N are held, where the hand is stopped"
    if chosen.unresisted.max() <= MAX_MISSING * target.force:
        return Finding(name, True, text)
    some = bool(chosen.locked.any())
    why = "" if some else "; no brake can" if strengths.any() else "; no module has a brake"
    return Finding(name, None if some else False, text + why)
