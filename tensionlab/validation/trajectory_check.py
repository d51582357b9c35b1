"""Checks of a trajectory: whether tensions render it, winches wind as fast, and cables stay clear."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tensionlab.allocation import Allocation, allocate
from tensionlab.hardware.protocol.codes import PARAMETERS
from tensionlab.hardware.simulation.simulated_module import PLANT
from tensionlab.model.module import Module
from tensionlab.model.requirement import Requirement
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.formatting import format_range, format_vector
from tensionlab.support.table import Column, Finding
from tensionlab.trajectory import Trajectory
from tensionlab.workspace.interference import body_distances, cable_distance
from tensionlab.workspace.structure_metrics import feasibility_tolerance
from tensionlab.workspace.wrench_set import required_margin

WINCH_COLUMNS = {
    "winch": "winch",
    "tension_min_n": Column("tension min", "N", ".2f"),
    "tension_max_n": Column("max", "N", ".2f"),
    "rate_n_s": Column("rate", "N/s", ".3g"),
    "torque_nm": Column("torque", "N·m", ".3f"),
    "speed_out_m_s": Column("out", "m/s", ".3f"),
    "speed_in_m_s": Column("in", "m/s", ".3f"),
    "speed_limit_m_s": Column("motor's limit", "m/s", ".3f"),
}


def winding_speed(module: Module, tension: Floats) -> Floats:
    """Return how fast a module's motor winds its cable in at a tension, in m/s; NaN without ``newton_per_ampere``.

    Its resistance takes part of the voltage between two phases, its motion induces the rest (power is 3/2 of the
    amplitudes of voltage and current); and the firmware pulls less above its own speed limit.
    """
    gain = math.nan if module.newton_per_ampere is None else module.newton_per_ampere
    voltage = PLANT["supply"].default / math.sqrt(3.0) - PLANT["resistance"].default * tension / gain
    return np.clip(voltage / (2.0 / 3.0 * gain), 0.0, PARAMETERS["speed_limit"].default)


def check_trajectory(rig: Rig, path: Trajectory, wrenches: Floats) -> tuple[list[Finding], list[list[Any]]]:
    """Check the samples of a trajectory, with the tensions of ``newton`` for its wrenches (K, n).

    Return the findings, and rows of `WINCH_COLUMNS`.
    """
    structure = rig.structure_matrix(path.position, path.rotation, rig.at_rest)
    allocation = allocate(structure, wrenches, rig.limits)
    winding = np.einsum("knm,kn->km", structure, path.twist(rig))
    able = np.stack(
        [winding_speed(*pair) for pair in zip(rig.modules, allocation.tensions.T, strict=True)], axis=-1
    )
    findings = [_feasible(rig, path, structure, wrenches), _motors(rig, path, winding, able)]
    if rig.bodies:
        margins = np.array([body.margin for body in rig.bodies])
        spare = body_distances(rig, path.position, path.rotation, rig.at_rest) - margins
        sample, cable, index = _smallest(spare)
        body, distance = rig.bodies[index], spare.min() + margins[index]
        text = f"{rig.modules[cable].name} is {distance:.3f} m from {body.name} {_at(path, sample)}"
        findings.append(Finding("bodies", bool(spare.min() >= 0.0), f"{text} (margin {body.margin:g} m)"))
    apart, pairs = cable_distance(rig, path.position, path.rotation, rig.at_rest)
    if np.isfinite(apart).any():
        sample = int(apart.argmin())
        names = " and ".join(rig.modules[index].name for index in pairs[sample])
        findings.append(Finding("cables", None, f"{names} are {apart[sample]:.3f} m apart {_at(path, sample)}"))
    return findings, _winches(rig, path, allocation, winding, able)


def _smallest(values: Floats) -> tuple[int, ...]:
    return tuple(map(int, np.unravel_index(np.nanargmin(values), values.shape)))


def _at(path: Trajectory, sample: int) -> str:
    return f"at {path.times[sample]:.4g} s, {format_vector(path.position[sample])} m"


def _feasible(rig: Rig, path: Trajectory, structure: Floats, wrenches: Floats) -> Finding:
    """Check that tensions inside the limits render each wrench, and how far it is from the edge."""
    margin = required_margin(rig, structure, Requirement(), added=wrenches)
    beyond = margin < -feasibility_tolerance(wrenches)
    worst, count = int(margin.argmin()), len(margin)
    if not beyond.any():
        text = f"feasible at all {count} samples, at least {max(margin[worst], 0.0):.3g} N from the edge"
        return Finding("tensions", True, f"{text} ({_at(path, worst)})")
    times = format_range(path.times[beyond])
    text = f"infeasible at {beyond.sum()} of {count} samples, from {times} s, by up to {-margin[worst]:.3g} N"
    return Finding("tensions", False, f"{text} ({_at(path, worst)}); go slower, or another way")


def _motors(rig: Rig, path: Trajectory, winding: Floats, able: Floats) -> Finding:
    """Check that each motor winds as fast as the path needs, at its tension."""
    spare = able - winding
    if np.isnan(spare).all():
        return Finding("motors", None, f"{rig.name} does not say newton_per_ampere, so its motors are unknown")
    sample, cable = _smallest(spare)
    fast, slow = able[sample, cable], winding[sample, cable]
    text = f"{rig.modules[cable].name} winds at {slow:.3g} m/s and can {fast:.3g} m/s {_at(path, sample)}"
    return Finding("motors", bool(spare[sample, cable] >= 0.0), text)


def _winches(rig: Rig, path: Trajectory, found: Allocation, winding: Floats, able: Floats) -> list[list[Any]]:
    """Return the rows of `WINCH_COLUMNS`; the motor's limit is that where it is closest."""
    rates = np.abs(np.diff(found.tensions, axis=0) / np.diff(path.times)[:, None]).max(axis=0)
    rows = []
    for number, module in enumerate(rig.modules):
        tension, speed, limit = found.tensions[:, number], winding[:, number], able[:, number]
        torque = None if module.spool_radius is None else tension.max() * module.spool_radius
        closest = float(limit[(limit - speed).argmin()])
        rows.append([module.name, tension.min(), tension.max(), rates[number], torque, max(0.0, -speed.min()),
                     max(0.0, speed.max()), None if math.isnan(closest) else closest])  # fmt: skip
    return rows
