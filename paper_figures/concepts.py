"""Figures of the pages on concepts: the available wrench set, the policies, brakes, delay, a module's states."""

from __future__ import annotations

from typing import Any

import numpy as np
from portraits import demonstration_rig

import tensionlab as tl
from benchmarks import pulley_error
from paper_figures.brake_maps import map_normals
from tensionlab.haptics.effects import Motion, Plane, Wall
from tensionlab.haptics.rendering.assignment import RULE, CableState, assign
from tensionlab.haptics.rendering.brakes import brake_map, brake_strengths
from tensionlab.haptics.rendering.field import predict
from tensionlab.hardware.protocol.codes import EVENTS, State
from tensionlab.hardware.simulation.simulated_module import TRANSITIONS
from tensionlab.model.directions import fibonacci
from tensionlab.model.wall_stiffness import (
    MARGIN,
    MIN_COSINE,
    MODULE_STIFFNESS,
    host_stiffness,
    stiffness_bound,
)
from tensionlab.plots.style import new_figure
from tensionlab.scenarios import load_scenario
from tensionlab.support.colours import BLUE, GREEN, GREY, ORANGE, RED

DESIRED = np.array([-8.0, -7.0])  # the infeasible wrench of the policies, in N
POLICY_LOOKS = {"force": (BLUE, "o"), "tension": (ORANGE, "s"), "direction": (GREEN, "^")}
SHADE = "#B9D7EA"
FORCE_AXES: Any = {"xlabel": "force along x (N)", "ylabel": "force along y (N)"}


def wrench_set() -> dict[str, Any]:
    """Return the demonstration rig, its available wrench set, and the capacity margin about zero."""
    rig = demonstration_rig()
    W = rig.structure_matrix(rig.home)
    corners = tl.workspace.vertices(W, rig.limits)
    return {"rig": rig, "W": W, "corners": corners, "margin": float(tl.workspace.capacity_margin(W, rig.limits))}


def draw_wrench_set(found: dict[str, Any]) -> Any:
    """Draw the rig with its unit vectors, and beside it all wrenches that it renders."""
    rig, W, corners, margin = found["rig"], found["W"], found["corners"], found["margin"]
    with new_figure((7.4, 3.4)) as figure:
        place, wrenches = figure.subplots(1, 2)
        for column, module in enumerate(rig.modules):
            place.plot(*np.stack([rig.home, module.anchor]).T, color=GREY, linewidth=1.0)
            place.plot(*module.anchor, "s", color="#222222", markersize=7)
            place.annotate(f"  {module.name}", module.anchor, va="center", fontsize=8)
            arrow(place, rig.home, rig.home + 0.45 * W[:, column], BLUE)
            beside = 0.34 * W[:, column] + (-1) ** column * 0.12 * np.array([-W[1, column], W[0, column]])
            place.annotate(f"u{column + 1}", rig.home + beside, ha="center", va="center", color=BLUE)
        place.plot(*rig.home, "o", color="#222222", markersize=5)
        place.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title="The rig", xlim=(-1.4, 1.9))
        wrenches.fill(*corners.T, facecolor=SHADE, edgecolor="#222222", linewidth=1.0)
        turn = np.linspace(0.0, 2.0 * np.pi, 121)
        wrenches.plot(margin * np.cos(turn), margin * np.sin(turn), color=RED)
        wrenches.plot(0.0, 0.0, "+", color="#222222")
        wrenches.annotate(
            f"capacity margin {margin:.2f} N", margin * np.array([0.7, -0.7]), (8.5, -8.5), color=RED,
            arrowprops={"arrowstyle": "-", "color": RED},
        )  # fmt: skip
        wrenches.annotate("available\nwrench set", (8.0, 4.0), ha="center", va="center")
        wrenches.set(
            aspect="equal", xlabel="force along x (N)", ylabel="force along y (N)", title="All it can render"
        )
    return figure


def arrow(axes: Any, begin: Any, end: Any, colour: str) -> None:
    """Draw an arrow."""
    axes.annotate("", end, begin, arrowprops={"arrowstyle": "-|>", "color": colour, "shrinkA": 0, "shrinkB": 0})


def policies() -> dict[str, Any]:
    """Return what each policy renders of a wrench that is infeasible, and the direction that certifies it."""
    rig = demonstration_rig()
    W = rig.structure_matrix(rig.home)
    answers = {name: tl.allocate(W, DESIRED, rig.limits, policy=name) for name in POLICY_LOOKS}  # type: ignore[arg-type]
    return {"corners": tl.workspace.vertices(W, rig.limits), "answers": answers, "W": W, "limits": rig.limits}


def draw_policies(found: dict[str, Any]) -> Any:
    """Draw the desired wrench, the three substitutes, and the line that separates it from all that is feasible."""
    corners, answers = found["corners"], found["answers"]
    d = answers["force"].separation / np.linalg.norm(answers["force"].separation)
    edge = max(corners @ d)
    along = np.array([-d[1], d[0]])
    foot = DESIRED - (DESIRED @ d - edge) * d
    with new_figure((7.0, 3.5)) as figure:
        axes = figure.subplots()
        axes.fill(*corners.T, facecolor=SHADE, edgecolor="#222222", linewidth=1.0)
        axes.annotate("available\nwrench set", (7.0, 3.5), ha="center", va="center")
        line = foot + np.array([[-9.0], [9.0]]) * along
        axes.plot(*line.T, "--", color=RED, linewidth=1.0)
        begin = foot - 7.0 * along
        arrow(axes, begin, begin + 2.5 * d, RED)
        axes.annotate("d", begin + 3.1 * d, color=RED, ha="center", va="center")
        axes.plot(*np.stack([np.zeros(2), DESIRED]).T, ":", color=GREY)
        axes.plot(*DESIRED, "*", color="#222222", markersize=12)
        axes.annotate("desired", DESIRED, (0, -14), textcoords="offset points", ha="center")
        for name, (colour, marker) in POLICY_LOOKS.items():
            answer = answers[name]
            axes.plot(*np.stack([DESIRED, answer.wrench]).T, color=colour, linewidth=0.8)
            label = f"{name}: {answer.residual:.2f} N off"
            axes.plot(*answer.wrench, marker, color=colour, markersize=7, markeredgecolor="white", label=label)
        axes.plot([], [], "--", color=RED, label="separates it from all that is feasible")
        axes.set(
            aspect="equal", xlabel="force along x (N)", ylabel="force along y (N)", xlim=(-11, 18), ylim=(-11, 15)
        )
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def brake_maps() -> tuple[dict[str, Any], Any]:
    """Return which walls the rig of the materials holds against 50 N, with motors alone and with brakes."""
    rig = load_scenario("materials").rig
    W, normals = rig.structure_matrix(rig.home), np.roll(map_normals(), 1, axis=1)  # z is up
    maps = {
        "Motors": brake_map(W, normals, 50.0, rig.limits, np.zeros(rig.m)),
        "Motors and brakes": brake_map(W, normals, 50.0, rig.limits, brake_strengths(rig)),
    }
    return maps, np.roll(W, -1, axis=0)


def draw_brake_cones(_: Any) -> Any:
    """Draw two locked cables in a plane: where the point can go, which pushes they hold, and a wall that traps."""
    cables = np.array([35.0, 110.0])  # directions, in degrees
    with new_figure((9.4, 4.0)) as figure:
        held, trapped = figure.subplots(1, 2)
        for axes in (held, trapped):
            axes.set(aspect="equal", xlim=(-1.5, 1.6), ylim=(-1.05, 1.3), xticks=[], yticks=[])
            axes.spines[:].set_visible(False)
        # The point moves where u_1·v >= 0 and u_2·v >= 0, and is held against the cone of u_1 and u_2.
        wedge(held, cables.max() - 90.0, cables.min() + 90.0, SHADE, "free to move")
        wedge(held, cables.min() + 180.0, cables.max() + 180.0, "#F3C98B", "held pushes")
        for number, direction in enumerate(cables, 1):
            cable(held, direction, BLUE)
            held.annotate(f"locked cable {number}", 1.22 * unit(direction), fontsize=9, ha="center", color=BLUE)
        held.set_title("Two locked brakes hold one cone of pushes")
        normal = 70.0
        side = 1.35 * unit(normal + 90.0)
        depth = 0.22 * unit(normal)
        trapped.fill(*np.array([side, -side, -side - depth, side - depth]).T, color="#DDDDDD")
        trapped.annotate("wall", 0.8 * side - 0.5 * depth, ha="center", va="center", rotation=normal - 90.0)
        cable(trapped, 35.0, BLUE)
        trapped.annotate("may be locked: u·n > 0", 1.18 * unit(35.0), fontsize=9, color=BLUE, ha="center")
        cable(trapped, 205.0, RED)
        word = "never: u·n < 0,\nit would trap the hand"
        trapped.annotate(word, (-0.75, -0.82), fontsize=9, color=RED, ha="center")
        arrow(trapped, np.zeros(2), 0.85 * unit(normal), "#222222")
        trapped.annotate("normal n", 0.95 * unit(normal), ha="center")
        trapped.plot(0.0, 0.0, "o", color="#222222")
        held.plot(0.0, 0.0, "o", color="#222222")
        trapped.set_title("Lock only cables that pull off the wall")
    return figure


def unit(degrees: float) -> Any:
    """Return the unit vector of an angle."""
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


def wedge(axes: Any, begin: float, end: float, colour: str, word: str) -> None:
    """Draw the directions between two angles in degrees, with their name."""
    arc = np.array([0.95 * unit(angle) for angle in np.linspace(begin, end, 60)])
    axes.fill(*np.vstack([np.zeros(2), arc]).T, color=colour)
    axes.annotate(word, 0.68 * unit((begin + end) / 2.0), ha="center", va="center", fontsize=9)


def cable(axes: Any, degrees: float, colour: str) -> None:
    """Draw the unit vector of a cable, from the hand."""
    arrow(axes, np.zeros(2), 1.1 * unit(degrees), colour)


def stiffness_bounds() -> dict[str, Any]:
    """Return the largest stable stiffness over the delay, for a module's loop and for a host's."""
    delay = np.linspace(0.0, 0.05, 201)
    return {"delay": delay, "bounds": {step: stiffness_bound(delay, step, 2.0) for step in (0.001, 0.02)}}


def draw_stiffness_bounds(found: dict[str, Any]) -> Any:
    """Draw the bounds, and the share of the host's that it may use."""
    milliseconds = 1e3 * found["delay"]
    with new_figure((6.6, 3.4)) as figure:
        axes = figure.subplots()
        for (step, bound), colour, dashes in zip(
            found["bounds"].items(), (BLUE, ORANGE), ("-", "--"), strict=True
        ):
            axes.semilogy(milliseconds, bound, dashes, color=colour, label=f"bound, loop of {1e3 * step:g} ms")
        axes.semilogy(
            milliseconds, MARGIN * found["bounds"][0.02], ":", color=GREEN, label="what the host may use"
        )
        axes.axhline(300.0, color=GREY, linewidth=0.8)
        axes.annotate("a wall of 300 N/m", (49.5, 320.0), ha="right", color=GREY)
        axes.set(xlabel="delay there and back (ms)", ylabel="stiffness (N/m)", xlim=(0.0, 50.0))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.legend(loc="upper right")
    return figure


WALL_RIGS = ("bartels2026-validation", "tetra-4", "cube-8", "seven-modules")
WALL = 200.0  # N/m


def wall_stiffness(count: int = 200) -> dict[str, Any]:
    """Return what is rendered of a wall along and across many normals at home, by rig, with one cable and a field.

    Arrays (2, 2, count) in N/m, sorted: one cable or a field, along or across.
    """
    found = {}
    for name in WALL_RIGS:
        rig = tl.load_rig(name)
        cables, home = rig.cables(rig.home), tuple(rig.home)
        state = CableState(cables.lengths, cables.directions, np.ones(rig.m, dtype=bool))
        rendered, usually = np.empty((2, 2, count)), {"stiffness": WALL, "stiffness across": 0.0}
        for index, normal in enumerate(fibonacci(count)):
            direction = cables.directions[np.argmax(cables.directions @ normal)]
            cosine = float(direction @ normal)
            stiffness = min(WALL / cosine**2, MODULE_STIFFNESS) if cosine >= MIN_COSINE else 0.0
            host = host_stiffness() / (1.0 - RULE.lead) if stiffness else host_stiffness()
            one = predict(stiffness * np.outer(direction, direction), normal, WALL, host)
            wall, motion = Wall(Plane(home, tuple(normal)), WALL), Motion(rig.home - 0.01 * normal, np.zeros(3))
            plan = assign((wall,), motion, state, host_stiffness=host_stiffness())
            softened = plan.demands[0].softened
            field = [softened[part][1] if part in softened else usual for part, usual in usually.items()]
            rendered[:, :, index] = (one.along, one.across), field
        found[name] = np.sort(rendered, axis=-1)
    return found


def draw_wall_stiffness(found: dict[str, Any]) -> Any:
    """Draw the share of normals along which a wall is rendered with at most a stiffness."""
    with new_figure((8.4, 4.4)) as figure:
        panels = figure.subplots(2, len(found), sharex=True, sharey=True)
        for column, (name, rendered) in zip(panels.T, found.items(), strict=True):
            share = np.linspace(0.0, 100.0, rendered.shape[-1])
            for part, axes in enumerate(column):
                for values, colour, label in zip(
                    rendered[:, part], (ORANGE, BLUE), ("one cable or the host", "field"), strict=True
                ):
                    axes.plot(share, values, color=colour, label=label)
                axes.axhline(WALL, color=GREY, linewidth=0.8)
            column[0].set_title(name, fontsize=9)
            column[1].set_xlabel("share of normals (%)")
        panels[0, 0].set(ylabel="along (N/m)", xlim=(0.0, 100.0), ylim=(0.0, 1.05 * WALL))
        panels[1, 0].set_ylabel("across (N/m)")
        panels[0, 2].legend(loc="center", fontsize=8)
    return figure


def pulley_errors() -> dict[float, Any]:
    """Return what fixed anchors cost where cables go over pulleys, by their radius in mm."""
    return {radius: np.round(found, 6) for radius, found in pulley_error.study(count=2000)[1].items()}


def draw_pulley_errors(found: dict[float, Any]) -> Any:
    """Draw the median errors of the force and below what 95 % are, over the radius."""
    radii, columns = list(found), (("position tracked", BLUE, "o"), ("position by lengths", ORANGE, "s"))
    with new_figure((6.6, 3.4)) as figure:
        axes = figure.subplots()
        for row, (name, colour, marker) in enumerate(columns):
            middle, most = np.array([np.quantile(each[row], [0.5, 0.95]) for each in found.values()]).T
            axes.plot(radii, most, ":", color=colour, marker=marker, label=f"{name}: 95 % are below")
            axes.plot(radii, middle, color=colour, marker=marker, label=f"{name}: median")
        axes.set(
            xlabel="radius of the pulleys (mm)", ylabel="error of the force (%)", xlim=(0, None), ylim=(0, None)
        )
        axes.legend(loc="upper left")
    return figure


FRAME = "armed or running"
STATE_PLACES = {
    "ESTOP": (-3.2, 0.0),
    "IDLE": (0.0, 0.0),
    "ARMED": (3.2, 0.0),
    "RUNNING": (6.2, 0.0),
    "TIMEOUT": (9.7, 1.9),
    "FAULT": (9.7, -1.9),
}  # where each state is drawn
DRIVEN = ("ARMED", "RUNNING")  # states that share a frame: what leads out of one of them leads out of the other


def module_states() -> dict[tuple[str, str], str]:
    """Return the event that leads from one state of a module to another, as the firmware decides."""
    return {
        (state.name, to.name): event
        for event, row in zip(EVENTS, TRANSITIONS, strict=True)
        for state, (accepted, to) in zip(State, row, strict=True)
        if accepted and to is not state
    }


def grouped(arrows: dict[tuple[str, str], str]) -> dict[tuple[str, str], str]:
    """Return the same arrows, those from all states and those from all driven ones drawn together."""
    left, found = dict(arrows), {}
    for event, states, name in (
        ("estop", [state.name for state in State if state.name != "ESTOP"], "any state"),
        *((event, list(DRIVEN), FRAME) for event in ("stop", "expire", "fault")),
    ):
        ends = {to for (begin, to), what in arrows.items() if what == event and begin in states}
        if len(ends) != 1 or not all((state, *ends) in left for state in states):
            raise ValueError(f"{event} does not lead from {', '.join(states)} to one state: draw it otherwise")
        (end,) = ends
        found[name, end] = event
        left = {key: what for key, what in left.items() if not (key[0] in states and what == event)}
    return found | left


BENDS: dict[tuple[str, str], tuple[Any, Any, Any, str]] = {
    ("any state", "ESTOP"): ((-3.2, 1.55), (-3.2, 0.42), (-3.2, 1.75), "estop, in any state"),
    ("ESTOP", "IDLE"): ((-2.35, 0.0), (-0.72, 0.0), (-1.55, 0.15), "clear"),
    ("IDLE", "ARMED"): ((0.72, 0.15), (2.35, 0.15), (1.45, 0.3), "arm"),
    (FRAME, "IDLE"): ((2.0, -0.2), (0.72, -0.2), (1.35, -0.55), "stop"),
    ("ARMED", "RUNNING"): ((4.0, 0.0), (5.25, 0.0), (4.62, 0.15), "set-point"),
    (FRAME, "TIMEOUT"): ((6.3, 0.78), (8.8, 1.75), (8.5, 0.85), "time to live over,\nor link closed"),
    (FRAME, "FAULT"): ((6.3, -0.78), (8.8, -1.75), (8.1, -1.15), "fault"),
    ("TIMEOUT", "FAULT"): ((9.7, 1.5), (9.7, -1.5), (10.15, -0.05), "fault"),
    ("TIMEOUT", "IDLE"): ((8.8, 2.05), (0.0, 0.42), (3.4, 1.6), "stop"),
    ("FAULT", "IDLE"): ((8.8, -2.05), (0.0, -0.42), (3.4, -1.9), "clear"),
}  # for each arrow: where it begins and ends, where its words are, and these


def draw_module_states(arrows: dict[tuple[str, str], str]) -> Any:
    """Draw the states of a module and what leads from one to another.

    Raises
    ------
    ValueError
        If the firmware has other transitions than the picture has arrows.
    """
    from matplotlib.patches import FancyBboxPatch

    drawn = grouped(arrows)
    if set(drawn) != set(BENDS):
        raise ValueError(f"the firmware's transitions are not those that are drawn: {set(drawn) ^ set(BENDS)}")
    with new_figure((7.4, 3.0)) as figure:
        axes = figure.subplots()
        axes.set(xlim=(-4.6, 10.8), ylim=(-2.4, 2.4), aspect="equal")
        axes.set_axis_off()
        axes.add_patch(
            FancyBboxPatch(
                (2.1, -0.75), 5.1, 1.5, "round,pad=0.05", facecolor="#EEF4F9", edgecolor=BLUE, linestyle="--"
            )
        )
        for name, (x, y) in STATE_PLACES.items():
            colour = {"TIMEOUT": "#FBE3BF", "FAULT": "#F6CDB8", "ESTOP": "#F6CDB8"}.get(name, SHADE)
            axes.add_patch(
                FancyBboxPatch(
                    (x - 0.7, y - 0.3), 1.4, 0.6, "round,pad=0.1", facecolor=colour, edgecolor="#444444"
                )
            )
            axes.annotate(name, (x, y), ha="center", va="center", fontsize=7.5, fontweight="bold")
        for key, (begin, end, where, word) in BENDS.items():
            arrow(axes, begin, end, RED if drawn[key] in ("estop", "fault", "expire") else "#333333")
            axes.annotate(word, where, ha="center", va="center" if "\n" in word or word == "fault" else "bottom",
                          fontsize=8.5)  # fmt: skip
    return figure
