"""Soak test of the runner: seven modules in their own processes behind bad links, and hosts that are killed.

``python -m benchmarks.soak`` (or ``make soak``) takes ten minutes, and some more for the kills.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from pathlib import Path

from benchmarks.processes import each_simulated, process, simulated
from benchmarks.soak_checks import Findings, examine
from tensionlab.hardware.client.group import modules_to_toml
from tensionlab.hardware.log.reader import read_run
from tensionlab.model.files import load_rig

RIG = Path("datasets/rigs/seven-modules.toml")
LINK = ("--latency-ms", 30, "--jitter-ms", 10, "--drop-pct", 1, "--corrupt-pct", 0.1)
"""Of each module: per cent of the bytes."""
ORBIT = ("--orbit", "0.05,10")
"""The hand goes round, 5 cm from its home, once in 10 s."""
TTL, LARGEST_ERROR = 0.5, 0.05
ON_THE_WAY = 0.1
"""How long a set-point, and then the telemetry that tells of it, are on their way, in s."""
HEAD = """name = "the force goes round"
repeat = true

[[steps]]
seconds = 1.0
wrench = [0.0, -0.5, -1.5]
"""
CORNERS = ((1.5, 0.3, 0.0), (0.0, 0.8, 1.5), (-1.5, 0.3, 0.0), (0.0, -0.5, -1.5))
STEP_SECONDS = 15.0
OLDEST_LOST = 1.0
"""A log may lack the last second before its host was killed."""


def program() -> str:
    """Return a program whose force goes round, slowly: a bad link is some 0.1 s behind."""
    steps = [f"[[steps]]\nseconds = {STEP_SECONDS}\nwrench = {list(corner)}\nramp = true\n" for corner in CORNERS]
    return HEAD + "\n" + "\n".join(steps)


def soak(seconds: float, folder: Path) -> Findings:
    """Run on seven modules behind bad links, and return the findings.

    Parameters
    ----------
    seconds : float
    folder : Path
        Gets the log, the recordings and what the run needs.

    Raises
    ------
    HardwareError
        If a process does not do what it is to.
    """
    rig = load_rig(RIG)
    recordings = [folder / f"{module.name}.csv" for module in rig.modules]
    calls: list[tuple[object, ...]] = [
        (RIG, "--only", module.name, "--seed", index, *LINK, *ORBIT, "--record", recording)
        for index, (module, recording) in enumerate(zip(rig.modules, recordings, strict=True))
    ]
    (folder / "program.toml").write_text(program(), encoding="utf-8")
    log = folder / "soak.mcap"
    log.unlink(missing_ok=True)
    with each_simulated(calls) as links:
        (folder / "modules.toml").write_text(modules_to_toml(links), encoding="utf-8")
        words = ("--modules", folder / "modules.toml", "--program", folder / "program.toml", "--log", log)
        with process("run", RIG, *words, "--ttl", TTL, "--seconds", seconds, "--json") as host:
            said, complaint = host.communicate(timeout=seconds + 120.0)
    if host.returncode != 0:
        print(said, complaint, file=sys.stderr)
    return examine(read_run(log), recordings)


def kills(count: int, folder: Path, seed: int = 0) -> list[str]:
    """Kill hosts at random moments; return those of their logs that do not open, or lack more than a second."""
    draw, wrong = random.Random(seed), []
    rig = Path("datasets/rigs/bartels2026-validation.toml")
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
    parser.add_argument("--out", type=Path, default=Path("out/soak"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    found = soak(options.seconds, options.out)
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
