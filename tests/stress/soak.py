"""Soak test of the runner: seven modules behind bad links, and hosts that are killed.

``python -m tests.stress.soak`` (or ``make soak``) plays ten minutes on a simulated clock, and kills hosts in
processes of their own. The same seed gives the same log.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks.processes import process, simulated
from tensionlab.demand import Pose
from tensionlab.hardware.client.modules_file import modules_to_toml
from tensionlab.hardware.log.reader import read_run
from tensionlab.hardware.log.writer import RunLog
from tensionlab.hardware.runner.program import Program, ProgramStep
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings, WorldClock
from tensionlab.hardware.simulation.links import Conditions
from tensionlab.hardware.simulation.world import World
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.support.arrays import Floats
from tensionlab.support.provenance import manifest
from tests.stress.soak_checks import Findings, LimitWatch, examine

RIG = "seven-modules"
LINK = Conditions(latency=0.030, jitter=0.010, drop=0.01, corrupt=0.001)  # of each module: shares of the bytes
ORBIT_M, ORBIT_S = 0.05, 10.0  # the hand goes round, so far from its home, once in so long
TTL, LARGEST_ERROR = 0.5, 0.05
ON_THE_WAY = 0.1  # how long a set-point, and then the telemetry that tells of it, are on their way, in s
START = (0.0, -0.5, -1.5)
CORNERS = ((1.5, 0.3, 0.0), (0.0, 0.8, 1.5), (-1.5, 0.3, 0.0), START)
START_SECONDS, STEP_SECONDS = 1.0, 15.0  # the force goes round slowly: a bad link is some 0.1 s behind
OLDEST_LOST = 1.0  # a log may lack the last second before its host was killed


def on_circle(rig: Rig, time: float) -> Floats:
    """Return the point at a time, in m: on a circle around home, across the axis that points up."""
    first, second = [axis for axis in range(3) if "xyz"[axis] != rig.vertical]
    angle = 2.0 * np.pi * time / ORBIT_S
    point: Floats = rig.home.copy()
    point[first] += ORBIT_M * np.cos(angle)
    point[second] += ORBIT_M * np.sin(angle)
    return point


def soak(seconds: float, log: Path, seed: int = 0) -> Findings:
    """Run on seven simulated modules behind bad links, and return the findings.

    Parameters
    ----------
    seconds : float
        Of simulated time.
    log : Path
        A file that is not there yet.
    seed : int
        Of sensors, links and numbers of messages.
    """
    rig = load_rig(RIG)
    world = World(rig, lambda time: Pose(on_circle(rig, time), frames=rig.at_rest), seed)
    watch = LimitWatch(rig.limits)
    world.watch = watch
    steps = [ProgramStep(START_SECONDS, np.array(START))]
    steps += [ProgramStep(STEP_SECONDS, np.array(corner), ramp=True) for corner in CORNERS]
    program = Program("the force goes round", tuple(steps), repeat=True)
    settings = RunSettings(ttl=TTL)
    links = dict.fromkeys((module.name for module in rig.modules), "sim:")
    record = RunLog(log, rig, manifest(["tests.stress.soak"], seed=seed), "newton", settings, links)
    Runner(rig, world.group(LINK, seed), "newton", program, settings, sinks=[record], clock=WorldClock(world)).run(
        seconds
    )
    return examine(read_run(log), watch.outside)


def kills(count: int, folder: Path, seed: int = 0) -> list[str]:
    """Kill hosts at random moments; return those of their logs that do not open, or lack more than a second."""
    draw, wrong = random.Random(seed), []
    rig = "bartels2026-validation"
    with simulated(rig) as (links, _):
        (folder / "killed.toml").write_text(modules_to_toml(links), encoding="utf-8")
        for index in range(count):
            log = folder / f"killed-{index}.mcap"
            log.unlink(missing_ok=True)
            with process(
                "run", rig, "--modules", folder / "killed.toml", "--force", 0, 0, 1, "--log", log
            ) as host:
                while not log.exists() or log.stat().st_size < 20_000:
                    time.sleep(0.01)
                time.sleep(draw.uniform(0.0, 1.5))
                host.kill()
                killed = time.time()
            run = read_run(log)
            if run.complete or not (run.cycle == range(len(run))).all():
                wrong.append(f"{log}: cycles are missing in the middle")
            if killed - run.began - run.time[-1] > OLDEST_LOST:
                wrong.append(f"{log}: ends {killed - run.began - run.time[-1]:.2f} s before its host was killed")
    return wrong


def main() -> None:
    """Soak from the command line; exit status 1 if something must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/soak"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    log = options.out / "soak.mcap"
    log.unlink(missing_ok=True)
    found = soak(options.seconds, log, options.seed)
    print(
        f"{found.cycles} cycles on seven modules, {found.statuses}\n"
        f"force: {100 * found.largest_error:.2f} % off at most, 99 % of {found.compared} within "
        f"{100 * found.often_error:.2f} %\noldest set-point followed: {1e3 * found.oldest:.0f} ms; "
        f"{found.went_back} went back; {found.outside} tensions outside their limits"
    )
    problems = found.problems(TTL + ON_THE_WAY, LARGEST_ERROR)
    lacking = kills(options.kills, options.out)
    print(f"{options.kills} hosts killed: {len(lacking)} logs that lack more than the last second")
    for problem in (*problems, *lacking):
        print(problem, file=sys.stderr)
    raise SystemExit(1 if problems or lacking else 0)


if __name__ == "__main__":
    main()
