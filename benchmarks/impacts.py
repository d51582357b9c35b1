"""Random impacts of a head on the wall of scenario B, and the largest force on it."""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from typing import Literal

import numpy as np

from tensionlab.errors import HardwareError, ScenarioError
from tensionlab.haptics.effects.contact import Plane
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.model.rig import Rig
from tensionlab.scenarios import PersonPlan, Scenario, Script, Waypoint, load_scenario
from tensionlab.scenarios.play import play, simulate_modules
from tensionlab.support.arrays import Floats

MAX_FORCE_N = 60.0  # allowed on a head
CONE_RAD = math.radians(40.0)  # largest angle between the wall's normal and a head's way
SHOULDERS = np.array([0.0, 0.0, -0.22])  # position of the torso relative to the head's script, in m
STILL_S, PUSHING_S = 0.05, 0.3  # time at the start, and time at the goal of the script, in the wall
PEAK_RATIO = 1.875  # peak over mean speed of a motion with minimum jerk
MAX_STOP_M = 0.02  # largest depth in the wall of a head that was stopped by it
# First decision at the wall, and its result: brakes were locked, and stopped it there, or it got further in; it
# was too fast for them; no brake was worth its price.
END = Literal["stopped", "gave way", "refused", "motors only"]
ENDS: tuple[END, ...] = ("stopped", "gave way", "refused", "motors only")


@dataclass(frozen=True)
class Impact:
    """Approach of a head to the wall.

    Attributes
    ----------
    speed : float
        Of its script at the wall, in m/s.
    direction : tuple of 3 floats
        Of that, a unit vector.
    position : tuple of 3 floats
        Where the script passes the wall, in m.
    distance : float
        From there to the start and to the goal of the script, in m.
    mass, stiffness : float
        Of the head in kg, and of the body that pushes it in N/m.
    latency : float
        Of the links, one way, in s.
    seed : int
        Of the modules' noise.
    """

    speed: float
    direction: tuple[float, ...]
    position: tuple[float, ...]
    distance: float
    mass: float
    stiffness: float
    latency: float
    seed: int

    @property
    def duration(self) -> float:
        """Duration of the motion, in s."""
        return PEAK_RATIO * 2.0 * self.distance / self.speed


@dataclass(frozen=True)
class Outcome:
    """Result of an impact.

    Attributes
    ----------
    impact : Impact
    force : float
        Largest true force on the head, in N.
    speed : float
        True speed at the wall, along its normal, in m/s; 0 if the head did not reach it.
    depth : float
        Largest depth in the wall, in m; below 0 if it did not.
    end : str
        One of `END`.
    fault : str
        Error that ended it early, if one did: all modules release their cables then.
    """

    impact: Impact
    force: float
    speed: float
    depth: float
    end: END
    fault: str


def draw_impact(rng: np.random.Generator, wall: Plane) -> Impact:
    """Return a random impact: its position, direction, speed and head.

    As many are from 0.05 to 0.32 m/s, where brakes may be locked, as from there to 2 m/s.
    """
    speed = math.exp(rng.uniform(math.log(0.05), math.log(2.0)))
    return Impact(
        speed=speed,
        direction=tuple(_within_cone(rng, -wall.n).tolist()),
        position=tuple((np.asarray(wall.point) + rng.uniform(-0.1, 0.1, 3) * (1.0 - np.abs(wall.n))).tolist()),
        distance=min(speed * rng.uniform(0.2, 0.6) / PEAK_RATIO, 0.6),
        mass=rng.uniform(3.0, 6.0),
        stiffness=rng.uniform(200.0, 1500.0),
        latency=rng.uniform(0.0, 0.02),
        seed=int(rng.integers(1 << 31)),
    )


def _within_cone(rng: np.random.Generator, axis: Floats) -> Floats:
    """Return a random direction, evenly distributed in the cone."""
    along = rng.uniform(math.cos(CONE_RAD), 1.0)
    across = rng.normal(size=3)
    across -= (across @ axis) * axis
    direction: Floats = along * axis + math.sqrt(1.0 - along**2) * across / np.linalg.norm(across)
    return direction


def scenario_of(impact: Impact, scenario: Scenario) -> Scenario:
    """Return a scenario with the person of an impact in place of its own."""
    position, way = np.array(impact.position), impact.distance * np.array(impact.direction)
    times = (STILL_S, STILL_S + impact.duration)
    head, torso = (
        Script(
            tuple(
                Waypoint(when, tuple((where + offset).tolist()))
                for when, where in zip(times, (position - way, position + way), strict=True)
            )
        )
        for offset in (np.zeros(3), SHOULDERS)
    )
    damping = 1.4 * math.sqrt(impact.stiffness * impact.mass)
    person = PersonPlan(impact.mass, impact.stiffness, damping, head, {"torso": torso})
    return replace(scenario, person=person, seconds=STILL_S + impact.duration + PUSHING_S)


def brake_wall(scenario: Scenario) -> Plane:
    """Return the plane of the first brake target with one."""
    return next(
        each.hold.plane for each in scenario.phases if each.hold is not None and each.hold.plane is not None
    )


def outcome(impact: Impact, scenario: Scenario) -> Outcome:
    """Return the outcome of an impact on simulated modules."""
    wall = brake_wall(scenario)
    played = scenario_of(impact, scenario)
    modules = simulate_modules(played, Conditions(impact.latency), impact.seed)
    decisions: list[str] = []
    fault = ""
    try:
        decisions = [event.text for event in play(played, modules).run.events if event.kind == "brake"]
    except HardwareError as error:
        fault = str(error)
    assert modules.person is not None
    record = modules.person.record
    inside = -wall.height(record.position)
    into = np.flatnonzero(inside > 0.0)
    speeds = np.gradient(inside, record.time)
    depth = float(inside.max())
    return Outcome(
        impact,
        float(np.linalg.norm(record.force, axis=1).max()),
        float(speeds[into[0]]) if into.size else 0.0,
        depth,
        _end(decisions, depth),
        fault,
    )


def _end(decisions: Sequence[str], depth: float) -> END:
    """Return how it ended, by the first decision about the brakes."""
    for text in decisions:
        if text.startswith("locked"):
            return "stopped" if depth <= MAX_STOP_M else "gave way"
        if text == "too fast":
            return "refused"
    return "motors only"


def with_strength(rig: Rig, strength: float) -> Rig:
    """Return a rig whose brakes give way at another force, in N."""
    modules = [each if each.brake is None else replace(each, brake=strength) for each in rig.modules]
    return replace(rig, modules=tuple(modules))


def impacts(scenario: Scenario, count: int, seed: int = 0, processes: int = 2) -> Iterator[Outcome]:
    """Yield the outcomes of random impacts; a seed gives the same ones, in the same order.

    The scenario has a torso, a rig of a head, and a brake target with a plane.
    """
    rng, wall = np.random.default_rng(seed), brake_wall(scenario)
    drawn = [draw_impact(rng, wall) for _ in range(count)]
    if processes == 1:
        yield from (outcome(each, scenario) for each in drawn)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(partial(outcome, scenario=scenario), drawn, chunksize=4)


def report(outcomes: Sequence[Outcome]) -> str:
    """Return a text about all outcomes."""
    forces = np.array([each.force for each in outcomes])
    worst = outcomes[int(forces.argmax())]
    lines = [
        f"{len(outcomes)} impacts: {forces.max():.1f} N at most, {np.percentile(forces, 99):.1f} N in 99 of 100; "
        f"{int((forces > MAX_FORCE_N).sum())} above {MAX_FORCE_N:.0f} N",
        f"the worst, {worst.end}: {worst.speed:.2f} m/s, {worst.impact.mass:.1f} kg, "
        f"{worst.impact.stiffness:.0f} N/m, {1e3 * worst.depth:.0f} mm deep",
    ]
    counts = Counter(each.end for each in outcomes)
    for end in ENDS:
        if counts[end]:
            some = [each for each in outcomes if each.end == end]
            depths, speeds = 1e3 * np.array([each.depth for each in some]), np.array([each.speed for each in some])
            lines.append(
                f"{end}: {100 * len(some) / len(outcomes):.1f} %, {speeds.min():.2f} to {speeds.max():.2f} m/s, "
                f"{np.median(depths):.0f} mm deep, {depths.max():.0f} at most, "
                f"{max(each.force for each in some):.1f} N at most"
            )
    faults = [each.fault for each in outcomes if each.fault]
    if faults:
        lines.append(f"{len(faults)} ended by a fault, one of them: {faults[0]}")
    return "\n".join(lines)


def main() -> None:
    """Play impacts from the command line; exit status 1 if a force was too large, or a module failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--strength", type=float, help="where brakes give way, in N; the rig's if left out")
    options = parser.parse_args()
    scenario = load_scenario("collision")
    if options.strength is not None:
        try:
            scenario = replace(scenario, rig=with_strength(scenario.rig, options.strength))
        except ScenarioError as error:
            parser.error(str(error))
    began = time.monotonic()
    outcomes = list(impacts(scenario, options.count, options.seed, options.processes))
    print(report(outcomes))
    print(f"in {time.monotonic() - began:.0f} s")
    raise SystemExit(any(each.force > MAX_FORCE_N or each.fault for each in outcomes))


if __name__ == "__main__":
    main()
