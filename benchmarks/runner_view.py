"""Benchmark of ``--view``: cycles of a run without it, with it, and with browsers that read, hang and draw.

``python -m benchmarks.runner_view`` (part of ``make bench-runner``). The cases take turns, round after round, so
that whatever else the computer does falls on all of them. A client that reads everything and draws nothing stands
for a browser on another computer, or one with a graphics card.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

from benchmarks.processes import simulated
from benchmarks.runner import FOUR, SEVEN, Turning
from tensionlab.hardware.client.group import connect
from tensionlab.hardware.runner.records import Statistics
from tensionlab.hardware.runner.runner import Runner
from tensionlab.hardware.runner.settings import RunSettings
from tensionlab.model.files import load_rig
from tensionlab.viewer.live import open_page
from tools.site.browser import installed

OPTIONS = (
    "--headless=new", "--no-sandbox", "--no-first-run", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader", "--disable-background-networking",
)  # fmt: skip
SETTLE_S = 10.0  # how long a browser may take to load the page before the run begins
READER = """
import sys, viser
from websockets.sync.client import connect
with connect(sys.argv[1], subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as own:
    while True:
        own.recv()
"""
ESTABLISHED = "01"
QUANTILES = (50.0, 99.0, 99.9)


@contextmanager
def page() -> Iterator[None]:
    """Serve the page of the run, and show it nowhere."""
    open_page()
    yield


@contextmanager
def reader() -> Iterator[None]:
    """Have a client read all that a browser would."""
    url = open_page()
    with ended(subprocess.Popen([sys.executable, "-c", READER, url.replace("http:", "ws:")])):
        yield from connected(url)


@contextmanager
def chromium(*, hangs: bool) -> Iterator[None]:
    """Have a browser show the page, by drawing in software; one that hangs is stopped before the run begins."""
    url, program = open_page(), installed()
    assert program is not None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        words = [program, *OPTIONS, f"--user-data-dir={folder}", url]
        browser = subprocess.Popen(words, stderr=subprocess.DEVNULL, process_group=0)
        with ended(browser):
            opened = connected(url)
            next(opened)
            if hangs:
                os.killpg(browser.pid, signal.SIGSTOP)
            yield
            next(opened, None)


@contextmanager
def ended(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Kill a process, and those of its group if it has its own, in the end."""
    try:
        yield
    finally:
        if os.getpgid(process.pid) == process.pid:
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.wait()


def connected(url: str) -> Iterator[None]:
    """Let a browser load the page; check, then and at the end, that it is connected."""
    time.sleep(SETTLE_S)
    require_connection(url)
    yield
    require_connection(url)


def require_connection(url: str) -> None:
    """Refuse a page without a connected browser."""
    port = f":{urlsplit(url).port:04X}"
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    if not any(line.split()[1].endswith(port) and line.split()[3] == ESTABLISHED for line in lines):
        raise SystemExit(f"no browser is connected to {url}")


CASES: dict[str, Callable[[], AbstractContextManager[None]]] = {
    "without --view": nullcontext,
    "--view, no browser": page,
    "--view, a client that reads and does not draw": reader,
    "--view, a browser that hangs": lambda: chromium(hangs=True),
    "--view, a browser that draws without a graphics card": lambda: chromium(hangs=False),
}


def run(name: str, rate: float, seconds: float, case: Callable[[], AbstractContextManager[None]]) -> Statistics:
    """Run on modules of another process, and return the statistics."""
    rig = load_rig(name)
    with simulated(name) as (links, _), case():
        group = connect(rig, links)
        try:
            return Runner(rig, group, "newton", Turning(rig), RunSettings(rate=rate)).run(seconds)
        finally:
            group.close()


def side_by_side(name: str, rate: float, seconds: float, rounds: int) -> None:
    """Print the times of the cycles of each case, over all rounds."""
    found: dict[str, list[Statistics]] = {case: [] for case in CASES}
    for _ in range(rounds):
        for case, opened in CASES.items():
            found[case].append(run(name, rate, seconds, opened))
    print(f"\n{name} over TCP, {rate:g} Hz, {rounds} x {seconds:g} s each; in us: median of the rounds (from, to)")
    for case, runs in found.items():
        print(case)
        for what, times in (("work of a cycle", "compute_times"), ("begins late by", "start_delays")):
            quantiles = 1e6 * np.array([np.percentile(getattr(one, times), QUANTILES) for one in runs])
            columns = zip(QUANTILES, np.median(quantiles, 0), quantiles.min(0), quantiles.max(0), strict=True)
            words = (
                f"{share:g} %: {middle:5.0f} ({low:.0f} to {high:.0f})" for share, middle, low, high in columns
            )
            print(f"    {what:16} {'   '.join(words)}")
        shares = sorted(100.0 * one.missed / (one.cycles + one.missed) for one in runs)
        print(f"    deadlines missed {np.median(shares):.2f} % ({shares[0]:.2f} to {shares[-1]:.2f})", flush=True)


def main() -> None:
    """Time the cases from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each run")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    os.environ["BROWSER"] = "true"  # the page opens none of its own
    if installed() is None:
        for case in list(CASES)[-2:]:
            print(f"no Chromium: {case} is left out")
            del CASES[case]
    side_by_side(FOUR, 1000.0, given.seconds, given.rounds)
    side_by_side(SEVEN, 100.0, given.seconds, given.rounds)


if __name__ == "__main__":
    main()
