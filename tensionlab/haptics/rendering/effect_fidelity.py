"""Fidelity of the effects of a run: from its cycles, live or logged, to a table."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tensionlab.demand import Demand, EffectDemand, EffectTable, RigState, measured_wrench, tabulate_effects
from tensionlab.haptics.rendering.fidelity import Fidelity, force_fidelity
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.colours import GREY
from tensionlab.support.formatting import format_number
from tensionlab.support.table import Column, Mark, Table, met_mark

MARKS = {True: met_mark(True), None: Mark("○", GREY, "nearest"), False: met_mark(False)}


def effects_fidelity(
    time: Floats,
    position: Floats,
    measured: Floats,
    effects: Mapping[str, EffectTable],
    infeasible: Floats,
    counts: NDArray[np.bool_],
) -> dict[str, Fidelity]:
    """Return the fidelity of each effect of a record, where ``counts`` (K,): brakes hold what no effect desires.

    What other effects desire at the same time is subtracted, so their errors are shared. ``infeasible`` (K, d) is
    the part of the demanded force that was proved infeasible; it excuses an effect that is right with it.
    """
    whole = sum((np.nan_to_num(effect.force) for effect in effects.values()), np.zeros_like(measured))
    fidelities = {}
    for name, effect in effects.items():
        now = np.isfinite(effect.share) & counts & np.isfinite(measured).all(axis=1)  # NaN: reports were old
        if now.any():
            force, others = effect.force[now], whole[now] - effect.force[now]
            spring = bool((effect.stiffness[now] > 0.0).any() or (effect.damping[now] > 0.0).any())
            judge = partial(
                force_fidelity, time[now], position[now], force, frequency=effect.frequency[now],
                amplitude=effect.amplitude[now], gain=effect.gain[now], share=effect.share[now], spring=spring,
            )  # fmt: skip
            fidelities[name] = judge(measured[now] - others)
            if fidelities[name].failures() and infeasible[now].any():
                excused = not judge((measured + infeasible)[now] - others).failures()
                fidelities[name] = replace(fidelities[name], infeasible=excused)
    return fidelities


class FidelityRecord:
    """Record of the latest cycles of a rig's run, in memory, for its fidelity."""

    def __init__(self, rig: Rig, length: int) -> None:
        self._rig, self._required = rig, rig.required.middle(rig)
        self._rows: deque[tuple[float, Floats, Floats, Floats, Mapping[str, EffectDemand], bool]] = deque(
            maxlen=length
        )

    def add(self, state: RigState, demand: Demand, infeasible: Floats | float = 0.0) -> None:
        """Add a cycle; its wrench, and the part ``infeasible`` (n,) of it, are without what the rig requires."""
        d = self._rig.dimension
        demanded = np.zeros(self._rig.n) if demand.wrench is None else np.asarray(demand.wrench)
        measured = measured_wrench(state.structure, state.tensions, state.active) - self._required
        effects = demand.effects
        if not effects and demand.wrench is not None:
            effects = {"force": EffectDemand((demanded if demand.desired is None else demand.desired)[:d])}
        missing = np.broadcast_to(infeasible, demanded.shape)[:d]
        row = (state.time, state.pose.position, measured[:d], missing, effects, not demand.brakes)
        self._rows.append(row)

    def fidelity(self) -> dict[str, Fidelity]:
        """Return the fidelity of each effect, or of the demanded force."""
        rows = list(self._rows)
        if not rows:
            return {}
        *arrays, effects, counts = zip(*rows, strict=True)
        time, position, measured, infeasible = map(np.array, arrays)
        tables = tabulate_effects(effects, self._rig.dimension)
        return effects_fidelity(time, position, measured, tables, infeasible, np.array(counts))


def fidelity_table(found: Mapping[str, Fidelity]) -> Table:
    """Return a row for each effect, and what a person would notice as notes."""

    def both(come: float, wanted: float, form: Callable[[float], str] = format_number) -> str | None:
        return None if math.isnan(wanted) else f"{form(come)} / {form(wanted)}"

    rows = []
    for name, fidelity in found.items():
        at_least = "≥ " * (fidelity.bandwidth == fidelity.excited)
        rows.append([
            MARKS[fidelity.passed], name, both(fidelity.force_rendered, fidelity.force),
            both(fidelity.stiffness, fidelity.stiffness_desired, "{:.0f}".format),
            both(fidelity.damping, fidelity.damping_desired), fidelity.error, fidelity.error_peak,
            fidelity.error_jnd, None if math.isnan(fidelity.bandwidth) else f"{at_least}{fidelity.bandwidth:.0f}",
            fidelity.direction, both(fidelity.amplitude, fidelity.amplitude_desired), 1e3 * fidelity.latency,
        ])  # fmt: skip
    columns = ["", "effect", Column("force", "N"), Column("stiffness", "N/m"),
               Column("damping", "N s/m", wide=True), Column("error", "N", format_number),
               Column("peak", "N", format_number),
               Column("error", "JND", ".1f"), Column("bandwidth", "Hz"), Column("off", "°", ".0f"),
               Column("vibration", "N"), Column("late", "ms", ".0f", wide=True)]  # fmt: skip
    notes = [
        f"{name}: {'; '.join(fidelity.failures())}{', which is infeasible' * (fidelity.passed is None)}"
        for name, fidelity in found.items()
        if fidelity.failures()
    ]
    return Table(columns, rows, "Fidelity: rendered / desired", notes)
