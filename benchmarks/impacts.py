"""Is a head ever pulled too hard? Many random impacts on the wall of scenario B, and what the head really felt."""

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

from tensionlab.arrays import Floats
from tensionlab.errors import HardwareError, ScenarioError
from tensionlab.haptics.effects.contact import Plane
from tensionlab.hardware.simulation.channel import Conditions
from tensionlab.model.rig import Rig
from tensionlab.scenarios import PersonPlan, Scenario, Script, Waypoint, load_scenario
from tensionlab.scenarios.expected_collision import hold_of
from tensionlab.scenarios.play import fast_enough, perform, simulated

MOST = 60.0
"""What a head may feel, in N."""
CONE = math.radians(40.0)
"""How far from the wall's normal heads come."""
SHOULDERS = np.array([0.0, 0.0, -0.22])
"""Where the torso is, as seen from the head that means to be somewhere, in m."""
STILL, PUSHING = 0.05, 0.3
"""How long a head stays where it begins, and where it means to get, in s."""
PEAK = 1.875
"""How much faster than on average a motion of the least jerk is half way."""
STOPPED = 0.02
"""How far into the wall a head is that was stopped by it, at most, in m."""
END = Literal["stopped", "gave way", "refused", "motors only"]
"""What was first decided at the wall, and what came of it: brakes were locked, and stopped it there, or it got
further in; it was too fast for them; no brake was worth its price."""
ENDS: tuple[END, ...] = ("stopped", "gave way", "refused", "motors only")


@dataclass(frozen=True)
class Impact:
    """How does a head come at the wall?

    Attributes
    ----------
    speed : float
        With which it means to pass it, in m/s.
    direction : tuple of 3 floats
        Of that, a unit vector.
    place : tuple of 3 floats
        Where, in m.
    distance : float
        From there to where it begins, and to where it means to get, in m.
    mass, stiffness : float
        Of the head in kg, and of the body that pushes it in N/m.
    latency : float
        Of the links, one way, in s.
    seed : int
        Of the modules' noise.
    """

    speed: float
    direction: tuple[float, ...]
    place: tuple[float, ...]
    distance: float
    mass: float
    stiffness: float
    latency: float
    seed: int

    @property
    def lasts(self) -> float:
        """How long does the motion take, in s?"""
        return PEAK * 2.0 * self.distance / self.speed


@dataclass(frozen=True)
class Outcome:
    """What became of an impact?

    Attributes
    ----------
    impact : Impact
    force : float
        The largest that the head really felt, in N.
    speed : float
        With which it really passed the wall, along its normal, in m/s; 0 if it did not.
    depth : float
        How far it got into the wall, in m; below 0 if it did not.
    end : str
        One of `END`.
    fault : str
        Which error ended it early, if one did: all modules let go then.
    """

    impact: Impact
    force: float
    speed: float
    depth: float
    end: END
    fault: str


def draw_impact(rng: np.random.Generator, wall: Plane) -> Impact:
    """Draw an impact: where and whence, how fast, and who.

    As many are from 0.05 to 0.32 m/s, where brakes may be locked, as from there to 2 m/s.
    """
    speed = math.exp(rng.uniform(math.log(0.05), math.log(2.0)))
    return Impact(
        speed=speed,
        direction=tuple(_within_cone(rng, -wall.n).tolist()),
        place=tuple((np.asarray(wall.point) + rng.uniform(-0.1, 0.1, 3) * (1.0 - np.abs(wall.n))).tolist()),
        distance=min(speed * rng.uniform(0.2, 0.6) / PEAK, 0.6),
        mass=rng.uniform(3.0, 6.0),
        stiffness=rng.uniform(200.0, 1500.0),
        latency=rng.uniform(0.0, 0.02),
        seed=int(rng.integers(1 << 31)),
    )


def _within_cone(rng: np.random.Generator, axis: Floats) -> Floats:
    """Draw a direction, evenly among those within the cone."""
    along = rng.uniform(math.cos(CONE), 1.0)
    across = rng.normal(size=3)
    across -= (across @ axis) * axis
    direction: Floats = along * axis + math.sqrt(1.0 - along**2) * across / np.linalg.norm(across)
    return direction


def scenario_of(impact: Impact, scenario: Scenario) -> Scenario:
    """Which scenario is it, in the place of another one?"""
    place, way = np.array(impact.place), impact.distance * np.array(impact.direction)
    times = (STILL, STILL + impact.lasts)
    head, torso = (
        Script(
            tuple(
                Waypoint(when, tuple((where + offset).tolist()))
                for when, where in zip(times, (place - way, place + way), strict=True)
            )
        )
        for offset in (np.zeros(3), SHOULDERS)
    )
    damping = 1.4 * math.sqrt(impact.stiffness * impact.mass)
    person = PersonPlan(impact.mass, impact.stiffness, damping, head, {"torso": torso})
    return replace(scenario, person=person, seconds=STILL + impact.lasts + PUSHING)


def outcome(impact: Impact, scenario: Scenario) -> Outcome:
    """What becomes of it on simulated modules?"""
    _, wall = hold_of(scenario)
    played = scenario_of(impact, scenario)
    modules = simulated(played, Conditions(impact.latency), impact.seed)
    heard: list[str] = []
    fault = ""
    with fast_enough(modules.group, played.slew):
        try:
            perform(played, modules, lambda kind, text: heard.append(text) if kind == "brake" else None)
        except HardwareError as error:
            fault = str(error)
    assert modules.person is not None
    felt = modules.person.felt
    inside = -wall.height(felt.position)
    into = np.flatnonzero(inside > 0.0)
    speeds = np.gradient(inside, felt.time)
    depth = float(inside.max())
    return Outcome(
        impact,
        float(np.linalg.norm(felt.force, axis=1).max()),
        float(speeds[into[0]]) if into.size else 0.0,
        depth,
        _end(heard, depth),
        fault,
    )


def _end(heard: Sequence[str], depth: float) -> END:
    """How did it end, by what was decided about the brakes? What came first counts."""
    for text in heard:
        if text.startswith("locked"):
            return "stopped" if depth <= STOPPED else "gave way"
        if text == "too fast":
            return "refused"
    return "motors only"


def with_strength(rig: Rig, strength: float) -> Rig:
    """A rig whose brakes give way elsewhere, in N."""
    modules = [each if each.brake is None else replace(each, brake=strength) for each in rig.modules]
    return replace(rig, modules=tuple(modules))


def impacts(scenario: Scenario, count: int, seed: int = 0, processes: int = 2) -> Iterator[Outcome]:
    """What becomes of random impacts? The same ones for a seed, and in the same order.

    Parameters
    ----------
    scenario : Scenario
        With a torso, a rig of a head, and a `Hold` with a plane.
    count, seed, processes : int
    """
    rng, (_, wall) = np.random.default_rng(seed), hold_of(scenario)
    drawn = [draw_impact(rng, wall) for _ in range(count)]
    if processes == 1:
        yield from (outcome(each, scenario) for each in drawn)
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(partial(outcome, scenario=scenario), drawn, chunksize=4)


def report(outcomes: Sequence[Outcome]) -> str:
    """Say what became of them."""
    forces = np.array([each.force for each in outcomes])
    worst = outcomes[int(forces.argmax())]
    lines = [
        f"{len(outcomes)} impacts: {forces.max():.1f} N at most, {np.percentile(forces, 99):.1f} N in 99 of 100; "
        f"{int((forces > MOST).sum())} above {MOST:.0f} N",
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
    """Play impacts from the command line; exit status 1 if a head felt too much, or a module failed."""
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
    raise SystemExit(any(each.force > MOST or each.fault for each in outcomes))


if __name__ == "__main__":
    main()
