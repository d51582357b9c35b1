"""Soak of ``tensionlab view``: a page on which an anchor is dragged for a long time, and its memory.

``python -m tests.stress.view_soak`` (also ``make soak-view``). An anchor is dragged, released and put back again
and again, with the workspace drawn. Each minute it is noted how much memory the server's process has, and how
much the page uses after its garbage was collected.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.view_browser import Shown, shown
from tools.site.browser import installed

REACH_PIXELS = 60.0
DRAG_STEPS = 60
# Of the time, after which memory must not grow: by then caches, and the steps that can be undone, are there.
WARM_SHARE = 0.25
MAX_GROWTH = 0.10  # of the memory then, by which it may be more at the end: allocators and collectors breathe
COLUMNS = ("server MB", "page MB", "nodes", "listeners")


def memory(page: Shown, session: Any) -> tuple[float, float, float, float]:
    """Return the memory of the server's process and of the page's objects, in MB, its nodes and listeners."""
    for line in Path(f"/proc/{page.server}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            resident = float(line.split()[1]) / 1e3
    session.send("HeapProfiler.collectGarbage")
    found = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
    return resident, found["JSHeapUsedSize"] / 1e6, found["Nodes"], found["JSEventListeners"]


def soak(page: Shown, minutes: float) -> list[tuple[float, ...]]:
    """Drag for some minutes; return the minute and the memory, about once a minute."""
    session = page.tab.context.new_cdp_session(page.tab)
    session.send("Performance.enable")
    page.choose("Workspace", "show", "surface")
    began, drags, answers = time.monotonic(), 0, 0
    rows: list[tuple[float, ...]] = []
    while True:
        minute = (time.monotonic() - began) / 60
        if not rows or minute >= rows[-1][0] + 1 or minute >= minutes:
            rows.append((minute, *memory(page, session)))
            values = "  ".join(f"{value:9.1f}" for value in rows[-1])
            print(f"{values}  {drags:7d}  {answers:8d}  {os.getloadavg()[0]:5.1f}", flush=True)
        if minute >= minutes:
            return rows
        page.tab.mouse.move(*page.anchor)
        page.tab.mouse.down()
        page.wander(DRAG_STEPS, REACH_PIXELS)
        page.tab.mouse.up()
        page.tab.get_by_role("button", name="Undo", exact=True).click()
        page.tab.wait_for_timeout(500.0)
        drags += 1
        answers += sum(1 for each in page.log() if each["kind"] == "received" and each["first"])
        page.forget()


def main() -> int:
    """Soak from the command line; exit status 1 if memory grew."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rig", nargs="?", default="bartels2026-validation")
    parser.add_argument("--minutes", type=float, default=20.0)
    given = parser.parse_args()
    if installed() is None:
        raise SystemExit("no Chromium: there is no page whose memory could grow")
    print(f"{'minute':>9}  " + "  ".join(f"{each:>9}" for each in COLUMNS) + "    drags   answers   load")
    with shown(given.rig) as page:
        rows = np.array(soak(page, given.minutes))
    warm = rows[rows[:, 0] >= WARM_SHARE * given.minutes]
    grown = warm[-1, 1:3] / warm[0, 1:3] - 1.0
    for name, share in zip(COLUMNS, grown, strict=False):
        print(f"{name} from minute {warm[0, 0]:.0f} to {warm[-1, 0]:.0f}: {100 * share:+.1f} %")
    return int(bool((grown > MAX_GROWTH).any()))


if __name__ == "__main__":
    raise SystemExit(main())
