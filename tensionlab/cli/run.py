"""``tensionlab run``: render forces on the modules of a rig; tables of a run and of its end."""

from __future__ import annotations

import sys
from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.runs import FidelitySink, end_run, open_sinks, print_fidelity, reach_modules, show_run
from tensionlab.cli.common.verbs import Json, flag, option
from tensionlab.demand import Demand, DemandSource, Pose, measured_wrench
from tensionlab.errors import HardwareError
from tensionlab.hardware.protocol.codes import Fault, Limit, State
from tensionlab.hardware.runner.program import load_program
from tensionlab.hardware.runner.records import Cycle
from tensionlab.hardware.runner.runner import Runner, Tracker
from tensionlab.hardware.runner.settings import OnLoss, RunSettings
from tensionlab.model.files import load_rig
from tensionlab.model.module import KINDS
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import pad_last_axis
from tensionlab.support.formatting import format_duration
from tensionlab.support.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


REFRESH_RATE_HZ = 5.0  # rate of the live table


def run(
    rig: options.RigArgument,
    modules: options.Modules = None,
    solver: options.Solver = "newton",
    policy: options.Policy = None,
    force: Annotated[
        str | None, option("X Y Z", "Desired force in N; torques in N·m may follow, and are 0 if left out.")
    ] = None,
    program: Annotated[Path | None, option("FILE", "Program (TOML): desired wrenches one after another.")] = None,
    at: Annotated[
        str | None, option("X Y Z", "Position of the point in m; computed from the cable lengths if left out.")
    ] = None,
    rate: Annotated[float, option("HZ", "Cycles per second.", callback=options.require_positive)] = 50.0,
    ttl: Annotated[
        float,
        option(
            "S", "Time to live of a set-point, and longest silence of a module.", callback=options.require_positive
        ),
    ] = 0.25,
    rate_limited: Annotated[
        bool, flag("--rate-limited", "Only tensions that modules reach within a cycle, in place of the solver's.")
    ] = False,
    real_time: Annotated[
        int | None,
        option("PROCESSOR", "Bind the run to a processor, with SCHED_FIFO and locked memory, if allowed."),
    ] = None,
    seconds: options.Duration = None,
    on_loss: Annotated[
        OnLoss, option("stop|continue", "When a module is lost: stop, or continue without it.")
    ] = "stop",
    log: options.Log = None,
    lsl: options.Lsl = False,
    view: options.View = False,
    require_fidelity: Annotated[
        bool, flag("--require-fidelity", "Exit status 1 where a person would notice a wrong force.")
    ] = False,
    json: Json = False,
) -> None:
    """Render forces on the modules of a rig. Without a force or a program, the cables are held taut.

    Ctrl-C ends the run. However it ends, all modules are stopped. Exit status 1 where something went wrong with
    a module, a module did not confirm that it has stopped, or an emergency stop ended the run.
    """
    from rich.live import Live

    loaded = load_rig(rig)
    demand = _demand(loaded, force, program, rate)
    if require_fidelity and force is None and program is None:
        raise typer.BadParameter("--require-fidelity is for a desired force; give --force or --program")
    settings = RunSettings(rate, ttl, on_loss, policy, rate_limited, real_time)  # type: ignore[arg-type]  # it checks them
    options.check_solvers(loaded, [solver], policy)
    tracker = _tracker(loaded, at)
    if view:
        show_run()
    group, clock, links = reach_modules(loaded, modules, tracker)
    failure: HardwareError | None = None
    with closing(group):
        runner = Runner(loaded, group, solver, demand, settings, clock=clock, tracker=tracker)
        judge = FidelitySink(loaded)
        runner.sinks += [*open_sinks(log, loaded, solver, settings, links, lsl), judge]
        live = Live(
            get_renderable=lambda: live_table(runner),
            console=output.console(),
            refresh_per_second=REFRESH_RATE_HZ,
            transient=True,
        )
        with live if sys.stdout.isatty() and not json else nullcontext():
            try:
                runner.run(seconds)
            except HardwareError as error:
                failure = error
    fidelities = judge.fidelity()
    if json:
        fidelity = {name: effect.summary() for name, effect in fidelities.items()}
        output.print_json(runner.statistics.summary() | {"fidelity": fidelity})
    else:
        print_summary(runner)
        print_fidelity(fidelities)
    end_run(runner.statistics, runner.sinks, log, failure)
    if require_fidelity and not all(effect.passed for effect in fidelities.values()):
        raise typer.Exit(1)


def _demand(rig: Rig, force: str | None, program: Path | None, rate: float) -> DemandSource:
    if force is not None and program is not None:
        raise typer.BadParameter("--force and --program are both given; give one of them")
    if program is not None:
        return load_program(program, rig, rate)
    if force is None:
        return lambda state: Demand()
    wrench = np.array(options.parse_numbers("--force", force))
    if wrench.size != rig.dimension:
        wrench = np.array(options.parse_components("--force", force, options.wrench_components(rig), rig.name))
    constant = Demand(pad_last_axis(wrench, rig.n))
    return lambda state: constant


def _tracker(rig: Rig, at: str | None) -> Tracker | None:
    """Return where the point is at each time; None if the cable lengths are to show it."""
    if at is None:
        return None
    position = options.parse_position(at, rig)
    rig.lengths(position, frames=rig.at_rest)  # refuses what is no position
    pose = Pose(position, frames=rig.at_rest)
    return lambda time: pose


def live_table(runner: Runner) -> RenderableType:
    """Return a table of how each module is now, and how the run goes."""
    cycle, statistics = runner.latest, runner.statistics
    if cycle is None:
        return "arming, and reeling in slack cables: hold the platform still ..."
    state, wrenches = cycle.state, _wrenches(cycle, runner.rig)
    rows = []
    for index, module in enumerate(runner.rig.modules):
        if state.active[index]:
            limit, now = Limit(int(state.limiters[index])), State(int(state.states[index])).name.lower()
        else:
            limit, now = Limit.NONE, f"lost {Fault(int(state.faults[index])).name or ''}"
        rows.append((module.name, cycle.commanded[index], state.tensions[index],
                     "–" if limit is Limit.NONE else limit.name.lower(), now,
                     state.windings[index], 1e3 * state.ages[index]))  # fmt: skip
    jitter, compute = (format_duration(times[1]) for times in statistics.percentiles().values())
    notes = f"{statistics.answers} · compute time {compute} (p99)"
    notes += f" · start jitter {jitter}" * statistics.in_real_time
    if statistics.missed:
        notes += f" · {statistics.missed} deadlines missed"
    title = f"{runner.rig.name}, {state.time:.1f} s: desired {wrenches.get('desired', 'taut cables')}"
    columns = ["module", Column("commanded", "N", ".2f"), Column("measured", "N", ".2f"), "limited by", "state",
               Column("winding", "°C", ".0f"), Column("age", "ms", ".0f")]  # fmt: skip
    return output.styled(Table(columns, rows, f"{title}, measured {wrenches['measured']}", [notes]))


def print_summary(runner: Runner) -> None:
    """Print how a run went, and what its last cycle rendered."""
    cycle, statistics = runner.latest, runner.statistics
    rows = statistics.rows()
    if cycle is not None and cycle.demand.wrench is not None:
        rows += [(f"{name} in the last cycle", text) for name, text in _wrenches(cycle, runner.rig).items()]
    rows += [
        (f"damaged frames of {client.name}", str(client.bad_frames))
        for client in runner.modules.clients
        if client.bad_frames
    ]
    output.print_table(Table(["", ""], rows, f"{runner.rig.name}: {statistics.title}"))


def _wrenches(cycle: Cycle, rig: Rig) -> dict[str, str]:
    """Return desired, commanded and measured wrench, if there is one, in texts that keep their width."""
    demand = cycle.demand
    state = cycle.state
    wrenches = {"measured": measured_wrench(state.structure, state.tensions, state.active)}
    if demand.wrench is not None:
        local = demand.wrench - cycle.solver_wrench  # by impedances and lost modules
        desired = demand.wrench if demand.desired is None else demand.desired
        wrenches = {"desired": desired, "commanded": cycle.allocation.wrench + local, **wrenches}
    unit = KINDS[rig.kind].wrench_unit
    return {
        name: "unknown: a module's report is old"
        if np.isnan(wrench).any()
        else f"({', '.join(f'{value + 0.0:5.2f}' for value in wrench.round(2))}) {unit}"
        for name, wrench in wrenches.items()
    }
