"""Benchmark of ``tensionlab view``: times from a drag to what is drawn, measured in a browser.

``python -m benchmarks.view_latency`` (also ``make bench-view``). An anchor is dragged with the mouse; hooks in the
page note when the mouse moved, when the page sent that, when the answer arrived, when the new cables or the new
surface were drawn (all commands of WebGL done), and when the margin changed in the panel. The browser draws in
software. Other load disturbs; it is printed, and the lower quartile suffers least from it.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from benchmarks.view_browser import Shown, shown
from tensionlab.model.files import load_rig
from tensionlab.support.arrays import Floats
from tensionlab.viewer import workspace
from tensionlab.viewer.design_scene import draw
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.scene import bounds
from tensionlab.viewer.state import begin
from tools.site.browser import installed

RIGS = ("bartels2026-validation", "seven-modules", "ipanema-2")
REACH_PIXELS = 60.0
APART_MS = 400.0  # after a move, so that all that it brings has ended
FINE_MS = 3_000.0  # after a release, so that the fine workspace is there
NEAR_M = 2e-4
Log = list[dict[str, Any]]


def line(what: str, times: Sequence[float] | Floats, goal: str = "") -> None:
    """Print the lower quartile, median and 95th percentile of times in ms."""
    found = np.asarray(times, np.float64)
    if not len(found):
        print(f"    {what:46} nothing was seen")
        return
    low, middle, high = np.percentile(found, (25.0, 50.0, 95.0))
    print(f"    {what:46} {low:6.1f}  {middle:6.1f}  {high:6.1f}   {len(found):4d}  {goal}", flush=True)


def first(log: Log, start: float, kind: str, **wanted: Any) -> float:
    """Return when something was first noted after a time; NaN if never."""
    for each in log:
        if each["kind"] == kind and each["at"] >= start and all(each.get(k) == v for k, v in wanted.items()):
            return float(each["at"])
    return float("nan")


def apart(page: Shown, moves: int) -> Floats:
    """Time single moves of the mouse, each after all is at rest; return anchors less mouse, (3,), in m."""
    rows, offset = [], np.zeros(3)
    for move in range(moves):
        page.forget()
        page.tab.mouse.move(*page.place(move / 4, REACH_PIXELS))
        page.tab.wait_for_timeout(APART_MS)
        log = page.log()
        moved = first(log, 0.0, "moved")
        sent = first(log, moved, "sent")
        answers = [each for each in log if each["kind"] == "received" and each["first"] and each["at"] >= sent]
        if not answers:
            continue
        received = answers[0]["at"]
        drawn = first(log, received, "drawn", what="/cables points")
        rows.append((
            sent - moved, received - sent, drawn - received, drawn - moved, first(log, sent, "text") - moved,
            first(log, sent, "drawn", what="/workspace vertices") - moved,
        ))  # fmt: skip
        place = next(each["place"] for each in log if each["kind"] == "sent")
        offset = np.array(answers[0]["first"][3:]) - place
    found = np.array(rows).T
    for what, times in zip(
        ("mouse to message", "message to answer: server and transport", "answer to drawn cables",
         "mouse to drawn cables", "mouse to the new margin in the panel"), found, strict=False,
    ):  # fmt: skip
        line(what, times[np.isfinite(times)])
    surfaces = found[-1][np.isfinite(found[-1])]
    if len(surfaces):
        line("mouse to the drawn surface of 30^3", surfaces, "goal: 150")
    return offset


def steadily(page: Shown, steps: int, offset: Floats) -> None:
    """Time what is drawn while the mouse moves all the time; places that were passed over do not count."""
    page.forget()
    frames = page.tab.evaluate("viewFrames")
    began = time.perf_counter()
    page.wander(steps, REACH_PIXELS)
    seconds = time.perf_counter() - began
    frames = page.tab.evaluate("viewFrames") - frames
    page.tab.wait_for_timeout(APART_MS)
    log = page.log()
    answers = [each for each in log if each["kind"] == "received" and each["first"]]
    moved = {tuple(each["first"]): moved_at(log, np.array(each["first"][3:]) - offset) for each in answers}
    drawn = [each for each in log if each["kind"] == "drawn" and each["what"] == "/cables points"]
    line("mouse to drawn cables", known(each["at"] - moved[tuple(each["first"])] for each in drawn), "goal: 50")
    texts = []
    for each in log:
        if each["kind"] == "text":
            before = [answer for answer in answers if answer["at"] <= each["at"]]
            texts += [each["at"] - moved[tuple(before[-1]["first"])]] if before else []
    line("mouse to the new margin in the panel", known(texts))
    surfaces = sum(each["kind"] == "drawn" and each["what"] == "/workspace vertices" for each in log)
    print(
        f"        a second: {frames / seconds:.0f} pictures, {surfaces / seconds:.0f} surfaces, "
        f"{len(answers) / seconds:.0f} answers of {np.median([each['count'] for each in answers]):.0f} messages "
        f"and {np.median([each['bytes'] for each in answers]) / 1e3:.1f} kB of arrays"
    )


def known(times: Iterable[float]) -> Floats:
    """Return those times that are numbers."""
    found = np.array(list(times))
    return np.asarray(found[np.isfinite(found)])


def moved_at(log: Log, place: Floats) -> float:
    """Return when the mouse came to a place, by what the page sent; NaN if it sent nothing near it."""
    sent = [each for each in log if each["kind"] == "sent"]
    away = [float(np.abs(each["place"] - place).max()) for each in sent]
    if not away or min(away) > NEAR_M:
        return float("nan")
    at = sent[int(np.argmin(away))]["at"]
    return max((each["at"] for each in log if each["kind"] == "moved" and each["at"] <= at), default=float("nan"))


def released(page: Shown, times: int) -> None:
    """Time how long after the release of an anchor the surface of 80^3 is drawn."""
    found = []
    for _ in range(times):
        page.tab.mouse.move(*page.anchor)
        page.tab.mouse.down()
        page.wander(10, REACH_PIXELS)
        page.tab.wait_for_timeout(APART_MS)
        page.forget()
        released_at = page.tab.evaluate("performance.now()")
        page.tab.mouse.up()
        page.tab.wait_for_timeout(FINE_MS)
        log = page.log()
        surfaces = [each for each in log if each["kind"] == "drawn" and each["what"] == "/workspace vertices"]
        if surfaces:
            found.append(max(surfaces, key=lambda each: int(each["length"]))["at"] - released_at)
        page.tab.get_by_role("button", name="Undo", exact=True).click()
        page.tab.wait_for_timeout(FINE_MS)
    line("release to the drawn surface of 80^3", found)


def server(name: str) -> None:
    """Time the parts of the server's work in this process, alone."""
    state = begin(load_rig(name))
    box = bounds(state.rig)
    found, coarse = evaluate(state), workspace.sweep(state, box, workspace.COARSE, lambda: True)
    assert coarse is not None
    parts: dict[str, tuple[int, Callable[[], object]]] = {
        "server: tensions, margin, available forces": (60, lambda: evaluate(state)),
        "server: arrays of the scene": (60, lambda: draw(state, found)),
        "server: workspace of 30^3": (15, lambda: workspace.sweep(state, box, workspace.COARSE, lambda: True)),
        "server: its surface": (15, lambda: workspace.surface(coarse, 0.0)),
        "server: workspace of 80^3": (3, lambda: workspace.sweep(state, box, workspace.FINE, lambda: True)),
    }
    for what, (times, call) in parts.items():
        taken = []
        for _ in range(times):
            began = time.perf_counter()
            call()
            taken.append(1e3 * (time.perf_counter() - began))
        line(what, taken)


def main() -> None:
    """Time the rigs from the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rigs", nargs="*", default=RIGS, metavar="RIG")
    parser.add_argument("--moves", type=int, default=60, help="single moves of each rig")
    given = parser.parse_args()
    if installed() is None:
        raise SystemExit("no Chromium found; install it to measure")
    for name in given.rigs:
        rig = load_rig(name)
        print(f"\n{name}: {rig.m} cables, {rig.n} wrench components; load {os.getloadavg()[0]:.1f}")
        print(f"    {'ms':44}  lower quartile, median, 95 %, number")
        server(name)
        with shown(name) as page:
            page.tab.mouse.move(*page.anchor)
            page.tab.mouse.down()
            print("  single moves, without a workspace")
            offset = apart(page, given.moves)
            print("  the mouse moves all the time, without a workspace")
            steadily(page, 6 * given.moves, offset)
            page.tab.mouse.up()
            page.choose("Workspace", "show", "surface")
            page.tab.wait_for_timeout(FINE_MS)
            page.tab.mouse.move(*page.place(6 * given.moves / 40, REACH_PIXELS))
            page.tab.mouse.down()
            print("  single moves, with the surface")
            offset = apart(page, given.moves)
            print("  the mouse moves all the time, with the surface")
            steadily(page, 6 * given.moves, offset)
            page.tab.mouse.up()
            for _ in ("with the surface", "without"):
                page.tab.wait_for_timeout(FINE_MS)
                page.tab.get_by_role("button", name="Undo", exact=True).click()
            page.tab.wait_for_timeout(FINE_MS)
            released(page, 5)
        print(f"    load at the end: {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
