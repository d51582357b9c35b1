"""What ``tensionlab run`` shows: a live table of the modules, and how it went."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

from tensionlab.cli.common import output
from tensionlab.hardware.protocol.codes import Fault, Limit, State
from tensionlab.solvers.base import Status

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from tensionlab.arrays import Floats
    from tensionlab.hardware.runner.runner import Runner
    from tensionlab.hardware.runner.statistics import Statistics

LIMITS = {
    Limit.NONE: "",
    Limit.LOWER: "taut minimum",
    Limit.UPPER: "upper limit",
    Limit.SLEW: "slew",
    Limit.THERMAL: "heat",
    Limit.SPEED: "speed",
    Limit.LENGTH: "length",
    Limit.RELEASING: "releasing",
    Limit.TIMEOUT: "timed out",
    Limit.IDLE: "driver off",
}
"""What keeps a module from what it is told, in a word or two."""


class Screen:
    """A table that is drawn anew while a run lasts, by a thread of its own. A context manager."""

    def __init__(self, runner: Runner, refresh: float) -> None:
        from rich.live import Live

        self._live = Live(
            get_renderable=lambda: live_table(runner),
            console=output.console(),
            refresh_per_second=refresh,
            transient=True,
            screen=False,
        )

    def __enter__(self) -> Self:
        """Show it."""
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Take it away."""
        self._live.stop()


def live_table(runner: Runner) -> RenderableType:
    """How is each module now, and how does the run go?"""
    from rich.console import Group
    from rich.text import Text

    cycle = runner.latest
    if cycle is None:
        return Text("arming ...")
    state = cycle.state
    asked = "taut cables" if cycle.demand.wrench is None else _components(cycle.demand.wrench)
    pulling = _components(state.structure @ state.tensions)
    title = f"{runner.rig.name}, {state.time:.1f} s: asked {asked}, pulling {pulling}"
    table = output.table()
    for name in ("module", "told", "pulls", "limited by", "state", "heat", "age"):
        table.add_column(name, justify="left" if name in ("module", "limited by", "state") else "right")
    for index, module in enumerate(runner.rig.modules):
        faults = Fault(int(state.faults[index]))
        table.add_row(
            module.name,
            f"{cycle.sent[index]:.2f} N",
            f"{state.tensions[index]:.2f} N",
            LIMITS[Limit(int(state.limits[index]))] if state.active[index] else "",
            State(int(state.states[index])).name if state.active[index] else f"lost {faults.name or ''}",
            f"{100.0 * state.thermal[index]:.0f} %",
            f"{1e3 * state.ages[index]:.0f} ms",
        )
    return Group(Text(title, style="bold"), table, Text(" · ".join(_figures(runner.statistics)), style="dim"))


def summary_table(runner: Runner) -> Table:
    """How did a run go?"""
    statistics = runner.statistics
    times = statistics.percentiles()
    table = output.table(f"{runner.rig.name}: {statistics.cycles} cycles, ended by: {statistics.ended}")
    table.show_header = False
    table.add_column()
    table.add_column()
    table.add_row("answers", _counts(statistics))
    table.add_row("begin after the deadline", _spread(times["late"]))
    table.add_row("work in a cycle", _spread(times["work"]))
    table.add_row("deadlines missed", str(statistics.missed))
    if statistics.slewed:
        table.add_row("cycles held back by the slew", str(statistics.slewed))
    for name, count in statistics.late_telemetry.items():
        table.add_row(f"cycles with late telemetry of {name}", str(count))
    for client in runner.modules.clients:
        if client.bad_frames:
            table.add_row(f"damaged frames of {client.name}", str(client.bad_frames))
    for name, upper in statistics.derated.items():
        table.add_row(f"derated: {name}", f"down to {upper:.2f} N, so that it did not get too hot")
    for name, why in statistics.lost.items():
        table.add_row(f"lost: {name}", why)
    return table


def _figures(statistics: Statistics) -> list[str]:
    late, work = statistics.percentiles().values()
    figures = [_counts(statistics), f"jitter {output.duration(late[1])}", f"work {output.duration(work[1])} (p99)"]
    return figures + ([f"{statistics.missed} deadlines missed"] if statistics.missed else [])


def _components(wrench: Floats) -> str:
    """Components that keep their width from one drawing to the next."""
    return "(" + ", ".join(f"{value + 0.0:5.2f}" for value in wrench.round(2)) + ")"


def _counts(statistics: Statistics) -> str:
    """Status counts in words."""
    counts = [f"{statistics.statuses[status]} {status.name}" for status in Status if statistics.statuses[status]]
    if statistics.replaced:
        counts.append(f"{statistics.replaced} by newton in place of the solver")
    return ", ".join(counts) or "none"


def _spread(times: tuple[float, ...]) -> str:
    return (
        f"{output.duration(times[0])} median, {output.duration(times[1])} p99, {output.duration(times[2])} largest"
    )
