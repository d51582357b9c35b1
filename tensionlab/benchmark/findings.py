"""What the numbers of a benchmark say, in sentences computed from them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tensionlab.benchmark.headline import Headline, headlines
from tensionlab.benchmark.results import Results
from tensionlab.benchmark.rows import Row
from tensionlab.benchmark.text import duration, listed, newton, percent, times

SHOWN = 4
"""A sentence names at most so many contestants."""


def findings(results: Results) -> list[str]:
    """What did the benchmark find? A sentence where there is something to say."""
    sentences = (ask(results) for ask in QUESTIONS)
    return [sentence for sentence in sentences if sentence]


def _everything(results: Results) -> str | None:
    """Who solved every problem within reach, and who was fastest among them?"""
    lines = _present(results)
    whole = [line for line in lines if line.solved_1e6 == 1.0 and line.comparable]
    if not whole:
        return "Nobody solved every problem within reach to 1e-6 N."
    finest = [line for line in whole if line.solved_1e9 == 1.0]
    first = min(whole, key=lambda line: line.sgm_s)
    fine = "all" if finest == whole else f"{_names(finest)}" if finest else "none"
    text = (
        f"Every problem within reach is solved to 1e-6 N by {_names(whole)}; to 1e-9 N by {fine} of them. "
        f"Of these, the fastest single call is that of {first.label}, typically {duration(first.sgm_s)}"
    )
    house = [line for line in whole if line.house]
    if first.house or not house:
        return text + "."
    own = min(house, key=lambda line: line.sgm_s)
    return text + f"; {own.label} takes {duration(own.sgm_s)} with its proof."


def _defaults(results: Results) -> str | None:
    """Whose defaults are not good enough, and where?"""
    poor = [
        row
        for row in _within_reach(results)
        if row.setting == "default" and row.comparable and row.tried and row.solved_1e6 < 0.99
    ]
    worst: dict[str, Row] = {}
    for row in sorted(poor, key=lambda row: row.solved_1e6):
        worst.setdefault(row.solver, row)
    if not worst:
        return None
    parts = [
        f"{_short(row.solver)} {percent(row.solved_1e6)} of `{row.problem_set}` (errors up to "
        f"{newton(row.error_max)} N)"
        for row in list(worst.values())[:SHOWN]
    ]
    return f"At their defaults, some solve few problems to 1e-6 N: {listed(parts)}."


def _silent(results: Results) -> str | None:
    """Where is the wrench right, and are the tensions still not the optimal ones?"""
    rows = [
        row for row in _within_reach(results) if row.comparable and row.solved_1e6 == 1.0 and row.gap_max > 1e-4
    ]
    if not rows:
        return None
    row = max(rows, key=lambda row: row.gap_max)
    return (
        f"An accurate wrench does not mean the best tensions: {row.label} solves all of `{row.problem_set}` to "
        f"1e-6 N, yet a tension is up to {newton(row.gap_max)} N from the optimum."
    )


def _tight(results: Results) -> str | None:
    """What do tight settings cost?"""
    rows = {(row.problem_set, row.solver, row.setting): row for row in _within_reach(results)}
    factors: dict[str, list[float]] = {}
    for (name, solver, setting), row in rows.items():
        default = rows.get((name, solver, "default"))
        if setting == "tight" and default and row.sgm_s > 0 and default.sgm_s > 0:
            factors.setdefault(solver, []).append(row.sgm_s / default.sgm_s)
    if not factors:
        return None
    typical = sorted(
        ((float(np.exp(np.mean(np.log(each)))), solver) for solver, each in factors.items()), reverse=True
    )
    parts = [f"{_short(solver)} {factor:.2f}" for factor, solver in typical]
    return f"Tight settings cost, as a factor of the default's time: {listed(parts)}."


def _solve(results: Results) -> str | None:
    """How much of a call is the solve itself?"""
    shares: dict[str, list[float]] = {}
    for row in _within_reach(results):
        if row.setting == "default" and row.solve_s > 0:
            shares.setdefault(row.solver, []).append(row.solve_s / row.median_s)
    if not shares:
        return None
    means = sorted((float(np.mean(each)), solver) for solver, each in shares.items())
    parts = [f"{_short(solver)} {percent(share)}" for share, solver in means]
    return f"Share of a call that is the solve itself, by the backend's own clock: {listed(parts)}."


def _spread(results: Results) -> str | None:
    """Whose slow calls are far from its usual ones?"""
    lines = [line for line in _present(results) if np.isfinite(line.spread)]
    if len(lines) < 2:
        return None
    steady, wild = min(lines, key=lambda line: line.spread), max(lines, key=lambda line: line.spread)
    text = (
        f"In a control loop the slow calls count: p99.9 is {times(wild.spread)} times the median for {wild.label} "
        f"in its worst set (worst call {duration(wild.worst_s)}), and {times(steady.spread)} times for "
        f"{steady.label}"
    )
    own = [line for line in lines if line.label == "newton" and line is not steady]
    return text + (f"; {times(own[0].spread)} for newton." if own else ".")


def _beyond(results: Results) -> str | None:
    """Who has an answer where the wrench is out of reach?"""
    rows = [row for row in results.rows if results.sets[row.problem_set]["reachable"] == "none" and row.tried]
    if not rows:
        return None
    able = list(dict.fromkeys(row.label for row in rows if row.proved == row.tried))
    plain = [row for row in rows if row.setting != "proved"]
    text = f"Out of reach, every answer of {listed(able)} is proved to be its policy's best" if able else ""
    if plain:
        best = max(plain, key=lambda row: row.solved_1e3)
        most = percent(best.solved_1e3)
        shares = f"the plain program gives the closest wrench to 1e-3 N in {most} of the cases at most"
        text = f"{text}; {shares}" if text else f"Out of reach, {shares}"
    return f"{text}." if text else None


def _limits(results: Results) -> str | None:
    """Whose raw answers break limits most, within reach?"""
    rows = [row for row in _within_reach(results) if row.violation_max > 1e-3]
    worst: dict[str, Row] = {}
    for row in sorted(rows, key=lambda row: -row.violation_max):
        worst.setdefault(row.label, row)
    if not worst:
        return None
    parts = [
        f"{row.label} {newton(row.violation_max)} N (`{row.problem_set}`)" for row in list(worst.values())[:SHOWN]
    ]
    return f"Raw tensions leave their limits by up to: {listed(parts)}."


def _continuity(results: Results) -> str | None:
    """Whose tensions jump along a path?"""
    lines = [line for line in _present(results) if np.isfinite(line.jump_max) and line.solved_1e3 > 0.99]
    if len(lines) < 2:
        return None
    smooth, rough = min(lines, key=lambda line: line.jump_max), max(lines, key=lambda line: line.jump_max)
    return (
        f"Along the trajectories, the largest jump of a tension is {newton(smooth.jump_max)} N/mm for "
        f"{smooth.label} and {newton(rough.jump_max)} N/mm for {rough.label}."
    )


def _batch(results: Results) -> str | None:
    """How fast is a batch against DAQP's C?"""
    rows = [row for row in results.batches if np.isfinite(row.ratio)]
    if not rows:
        return None
    parts = [f"1/{1 / row.ratio:.1f} for n = {row.components}, m = {row.cables}" for row in rows if row.reachable]
    loop = max(row.daqp_loop_s / row.all_cores_s for row in rows if row.reachable)
    return (
        "In one large batch on one core, newton's time for a problem, proof included, is this share of DAQP's "
        f"own C time: {listed(parts)}; on {rows[0].cores} cores it is up to {times(loop)} times faster than a "
        "Python loop over DAQP."
    )


QUESTIONS: tuple[Callable[[Results], str | None], ...] = (
    _everything,
    _batch,
    _defaults,
    _silent,
    _tight,
    _solve,
    _spread,
    _limits,
    _beyond,
    _continuity,
)


def _present(results: Results) -> list[Headline]:
    return [line for line in headlines(results) if np.isfinite(line.sgm_s)]


def _within_reach(results: Results) -> list[Row]:
    return [row for row in results.rows if results.sets[row.problem_set]["reachable"] == "all"]


def _names(lines: list[Headline]) -> str:
    """The contestants by name, default and tight together."""
    names: dict[str, list[str]] = {}
    for line in lines:
        name, _, setting = line.label.partition(", ")
        names.setdefault(name, []).append(setting)
    return listed(
        [name if len(found) > 1 or not found[0] else f"{name} ({found[0]})" for name, found in names.items()]
    )


def _short(solver: str) -> str:
    """A peer's name where it is clear that peers are meant."""
    return solver.removesuffix(":plain")
