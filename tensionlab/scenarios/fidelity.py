"""Rendered force of a played scenario over time, and the fidelity of its effects and brakes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tensionlab.allocation import Status
from tensionlab.demand import EffectTable, measured_wrench
from tensionlab.haptics.rendering.effect_fidelity import effects_fidelity
from tensionlab.haptics.rendering.fidelity import Fidelity, force_fidelity
from tensionlab.hardware.log.reader import Run
from tensionlab.scenarios.play import ScenarioResult
from tensionlab.support.arrays import Floats

LOCKING_S, RELEASE_S = 0.1, 0.35  # times in which a brake locks, and its force is gone


@dataclass(frozen=True, eq=False)
class ForceRecord:
    """Force (K, d) in N on the hand or head over time, and its position in the frame of the effects, in m."""

    time: Floats
    position: Floats
    force: Floats

    def during(self, begin: float, end: float) -> ForceRecord:
        """Return the part from one time to another."""
        part = between(self.time, begin, end)
        return ForceRecord(self.time[part], self.position[part], self.force[part])


def rendered_force(result: ScenarioResult) -> ForceRecord:
    """Return the true force on the simulated person, each ms, or the measured one, each cycle."""
    run, person, frame = result.run, result.person, result.scenario.frame
    if person is not None:
        position = person.position
        if frame is not None:
            script = result.scenario.person.bodies[frame]
            position = position - np.array([script.position(time) for time in person.time])
        return ForceRecord(person.time, position, person.force)
    position = run.position
    if frame is not None:  # by the cable of a module on that body
        index = [module.frame for module in run.rig.modules].index(frame)
        position = run.rig.anchors[index] - run.structure[:, :, index] * run.lengths[:, index, None]
    force = measured_force(run)
    known = np.isfinite(force).all(axis=1)
    return ForceRecord(run.time[known], position[known], force[known])


def between(time: Floats, begin: float, end: float) -> NDArray[np.bool_]:
    """Return which times are from one to another."""
    return np.asarray((time >= begin) & (time < end))


def loop_delay(result: ScenarioResult) -> float:
    """Return the largest delay of the loop, in s."""
    return float(np.nanmax(result.run.delays, initial=0.0))


def run_fidelity(run: Run) -> dict[str, Fidelity]:
    """Return the fidelity of each effect of a run, by the reported tensions; of its force where it has no effects.

    Examples
    --------
    >>> from tensionlab.scenarios import load_scenario
    >>> from tensionlab.scenarios.fidelity import run_fidelity
    >>> from tensionlab.scenarios.play import play, simulate_modules
    >>> weight = load_scenario("weight")
    >>> found = run_fidelity(play(weight, simulate_modules(weight), seconds=2.0).run)
    >>> found["weight"].failures()
    ()
    """
    d = run.rig.dimension
    desired = (run.desired - run.rig.required.middle(run.rig))[:, :d]
    effects = run.effects
    if not effects and np.isfinite(desired).any():
        nothing = np.where(np.isfinite(desired[:, 0]), 0.0, np.nan)
        effects = {"force": EffectTable(desired, *4 * [nothing], *2 * [nothing + 1.0])}
    measured, free = measured_force(run)[:, :d], ~_braked(run, run.time)
    missing = infeasible_force(run)[:, :d]
    return effects_fidelity(run.time, run.position, measured, effects, missing, free)


def scenario_fidelity(result: ScenarioResult) -> dict[str, Fidelity]:
    """Return the fidelity of each effect of a scenario, and of its brakes, by the true force on a person.

    Of a real person it is that by the reported tensions, and what brakes hold is not known.
    """
    run, person, record = result.run, result.person, rendered_force(result)
    if person is None or not len(run):
        return run_fidelity(run)
    last = np.maximum(np.searchsorted(run.time, person.time, side="right") - 1, 0)

    def fill(values: Floats) -> Floats:
        """Return values between cycles; NaN where the cycle before has none."""
        columns = np.nan_to_num(values).reshape(len(run), -1).T
        lines = np.stack([np.interp(person.time, run.time, column) for column in columns], axis=1)
        return np.where(np.isnan(values[last]), np.nan, lines.reshape(-1, *values.shape[1:]))

    known = {name: EffectTable(*map(fill, effect)) for name, effect in run.effects.items()}
    effects = {name: effect._replace(gain=np.ones(len(person.time))) for name, effect in known.items()}
    missing, free = fill(infeasible_force(run)), ~_braked(run, person.time)
    fidelities = effects_fidelity(person.time, record.position, person.force, effects, missing, free)
    for phase in result.scenario.phases:
        locks: NDArray[np.bool_] = np.asarray(run.commanded_brakes.any(axis=1))
        held = between(person.time, phase.begin, phase.end) & locks[last]
        held &= locks[np.searchsorted(run.time[1:], person.time - LOCKING_S)]
        if phase.hold is not None and held.any():
            normal = np.array([phase.hold.wall(position).normal for position in record.position[held]])
            push = np.maximum(np.vecdot(person.force[held], normal), 0.0)[:, None] * normal
            force = person.force[held]
            fidelities[f"{phase.name}: brakes"] = force_fidelity(
                person.time[held], record.position[held], push, force, spring=False
            )
    return fidelities


def _braked(run: Run, time: Floats) -> NDArray[np.bool_]:
    """Return at which times a brake holds or opens."""
    on = run.time[run.commanded_brakes.any(axis=1)]
    if not on.size:
        return np.zeros(time.shape, dtype=bool)
    latest = on[np.maximum(np.searchsorted(on, time, side="right") - 1, 0)]
    return np.asarray((time >= latest) & (time - latest < RELEASE_S))


def desired_force(run: Run) -> Floats:
    """Return the desired force on the hand, (K, n) in N, without the rig's required wrench."""
    return run.desired - run.rig.required.middle(run.rig)


def measured_force(run: Run) -> Floats:
    """Return the force on the hand by the reported tensions, (K, n) in N; NaN where one is unknown."""
    force = measured_wrench(run.structure, run.measured, run.active)
    return force - run.rig.required.middle(run.rig)


def infeasible_force(run: Run) -> Floats:
    """Return the part of the demanded force that was proved infeasible, (K, n) in N."""
    return np.where((run.status == Status.NEAREST)[:, None], run.solver_wrench - run.rendered, 0.0)
