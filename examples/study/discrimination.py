"""Force discrimination through the bridge: a person says which of two weights is heavier.

In one terminal ``tensionlab serve RIG``, with ``--lsl`` for its forces; in another one

    python examples/study/discrimination.py ws://127.0.0.1:8765 --out participant-01

asks a person, who holds the point of the rig. ``--subject 10`` asks a simulated subject with a threshold of 10 %,
who feels what the modules report. The folder gets ``trials.csv`` (each row as soon as it is answered),
``trials.parquet``, ``markers.csv`` and ``staircase.png``; with pylsl, markers are also a stream of Lab Streaming
Layer.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from staircase import Staircase, Subject, Threshold, fit_threshold, proportion_correct

from tensionlab.errors import TensionlabError
from tensionlab.haptics.bridge.client import BridgeClient
from tensionlab.support.provenance import manifest, write_parquet

GRAVITY_M_S2 = 9.80665
FRAME_S = 1.0 / 90.0  # time between frames
SETTLING_S = 0.1  # time in which a force comes up, which does not count as felt
COLUMNS = ("trial", "run_time_s", "level_percent", "first", "desired_1_n", "desired_2_n", "felt_1_n", "felt_2_n",
           "answer", "correct", "reversal")  # fmt: skip


class Markers:
    """Texts with the time of the run and of LSL: a file, and a stream where pylsl is installed."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", newline="", encoding="utf-8")
        self._rows = csv.writer(self._file)
        self._rows.writerow(("run_time_s", "lsl_time_s", "text"))
        self._clock = self._outlet = None
        try:
            import pylsl
        except (ImportError, OSError, RuntimeError):  # without it, or without its library
            return
        info = pylsl.StreamInfo(
            "discrimination markers", "Markers", 1, pylsl.IRREGULAR_RATE, pylsl.cf_string, str(path)
        )
        self._clock, self._outlet = pylsl.local_clock, pylsl.StreamOutlet(info)

    def write(self, run_time: float, text: str) -> None:
        """Write a marker now."""
        stamp = None if self._clock is None else self._clock()
        if self._outlet is not None:
            self._outlet.push_sample([text], stamp)
        self._rows.writerow((f"{run_time:.4f}", "" if stamp is None else f"{stamp:.6f}", text))
        self._file.flush()

    def close(self) -> None:
        """Close the file and the stream."""
        self._file.close()
        self._outlet = None


class Session:
    """Trials through the bridge, each with two weights in random order."""

    def __init__(self, bridge: BridgeClient, markers: Markers, rng: np.random.Generator, options: Any) -> None:
        up = bridge.welcome.up
        if up is None:
            raise SystemExit(
                f'rig "{bridge.welcome.rig}" does not say which axis is up; give its file the key "up"'
            )
        self._bridge, self._markers, self._rng, self._options = bridge, markers, rng, options
        self._down, self._axis = (1.0 if up.startswith("-") else -1.0), "xyz".index(up[-1])
        self._start = time.monotonic()
        self.run_time = 0.0

    def render(self, force: float, seconds: float = 0.0, until: Thread | None = None) -> float:
        """Render a weight in N for a time, or until a thread has ended; return the mean force felt, in N."""
        weight = {"kind": "weight", "mass": force / GRAVITY_M_S2, "limit": 0.0}  # no inertia
        began = time.monotonic()
        felt = []
        while (now := time.monotonic()) - began < seconds or (until is not None and until.is_alive()):
            state = self._bridge.frame(now - self._start, effects={"weight": weight} if force else {})
            self.run_time = state.time
            measured = state.measured[self._axis]
            if measured is not None and now - began > SETTLING_S:
                felt.append(self._down * measured)
            time.sleep(FRAME_S)
        return float(np.mean(felt)) if felt else float("nan")

    def trial(self, number: int, level: float, subject: Subject | None) -> dict[str, Any]:
        """Present the standard and a comparison, ask which is heavier, and return the row of the table."""
        options = self._options
        forces = [options.standard, options.standard * (1.0 + level / 100.0)]
        order = self._rng.permutation(2)
        began, felt = 0.0, []
        for interval, which in enumerate(order, start=1):
            self.render(0.0, options.pause)
            began = began or self.run_time
            self._markers.write(self.run_time, f"trial {number} interval {interval}: {forces[which]:.3f} N")
            felt.append(self.render(forces[which], options.hold))
        answer = self._ask() if subject is None else subject.choose(*felt)
        correct = order[answer - 1] == 1
        self._markers.write(self.run_time, f"trial {number} answer: {answer}, {'right' if correct else 'wrong'}")
        first = ("standard", "comparison")[order[0]]
        desired = [forces[which] for which in order]
        return dict(
            zip(COLUMNS, (number, began, level, first, *desired, *felt, answer, bool(correct), False), strict=True)
        )

    def _ask(self) -> int:
        """Ask the person at the keyboard, while frames go on without a force."""
        replies: list[str] = []
        while True:
            print("Which was heavier, 1 or 2? ", end="", flush=True)
            reader = Thread(target=lambda: replies.append(sys.stdin.readline()), daemon=True)
            reader.start()
            self.render(0.0, until=reader)
            if not replies[-1]:
                raise EOFError("the keyboard's input has ended")
            if replies[-1].strip() in ("1", "2"):
                return int(replies[-1])


def run(options: argparse.Namespace) -> None:
    """Run a session, write its files and print the threshold."""
    with BridgeClient(options.url) as bridge:
        options.out.mkdir(parents=True)
        staircase, rows = Staircase(), []
        try:
            for row in answered_trials(bridge, staircase, options):
                rows.append(row)
        except (TensionlabError, KeyboardInterrupt, EOFError) as error:
            print(f"ended after {len(rows)} of {options.trials} trials: {error or 'interrupted'}", file=sys.stderr)
    if not rows:
        raise SystemExit("no trial was answered; nothing to fit")
    threshold = fit_threshold(staircase.levels, staircase.correct)
    about = {key: str(value) for key, value in vars(options).items()}
    about |= {"rig": bridge.welcome.rig, "threshold": threshold}
    write_parquet(options.out / "trials.parquet", rows, manifest(sys.argv, options.seed) | about)
    draw(staircase, threshold).savefig(options.out / "staircase.png", dpi=150)
    print(
        f"{len(rows)} trials, {len(staircase.reversals)} reversals; threshold {threshold.value:.1f} % of "
        f"{options.standard:g} N, 95 % interval {threshold.low:.1f} to {threshold.high:.1f} %"
    )
    if len(staircase.reversals) > staircase.left_out:
        print(f"mean of the reversals after the first {staircase.left_out}: {staircase.mean_of_reversals():.1f} %")


def answered_trials(
    bridge: BridgeClient, staircase: Staircase, options: argparse.Namespace
) -> Iterator[dict[str, Any]]:
    """Yield the row of each trial, when it is answered and written."""
    rng = np.random.default_rng(options.seed)
    subject = None if options.subject is None else Subject(options.subject, options.standard, rng)
    markers = Markers(options.out / "markers.csv")
    session = Session(bridge, markers, rng, options)
    with (options.out / "trials.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS)
        table.writeheader()
        try:
            for number in range(1, options.trials + 1):
                row = session.trial(number, staircase.level, subject)
                staircase.answer(row["correct"])
                row["reversal"] = number - 1 in staircase.reversals
                table.writerow(row)
                file.flush()
                yield row
        finally:
            markers.write(session.run_time, f"ended: {len(staircase.levels)} trials")
            markers.close()


def draw(staircase: Staircase, threshold: Threshold) -> Figure:
    """Draw the levels of the trials, and the fitted share of correct answers."""
    with mpl.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        track, fit = figure.subplots(1, 2, sharey=True, width_ratios=(2, 1))
    levels, correct = np.array(staircase.levels), np.array(staircase.correct)
    trials = np.arange(1, len(levels) + 1)
    track.plot(trials, levels, color="0.7", linewidth=1.0, zorder=1)
    for right, colour, name in ((True, "#0072b2", "right"), (False, "#d55e00", "wrong")):
        track.scatter(trials[correct == right], levels[correct == right], 16, colour, label=name, zorder=3)
    track.axhspan(threshold.low, threshold.high, color="#009e73", alpha=0.15, linewidth=0)
    track.axhline(threshold.value, color="#009e73", label=f"threshold {threshold.value:.1f} %, 95 % interval")
    ticks = [1, 2, 5, 10, 20, 50]
    track.set(
        yscale="log", yticks=ticks, yticklabels=ticks, xlabel="trial", ylabel="difference (% of the standard)"
    )
    track.minorticks_off()
    track.legend(loc="upper right", frameon=False)
    grid = np.geomspace(min(levels.min(), 1.0), max(levels.max(), 50.0), 200)
    fit.plot(proportion_correct(grid, threshold.value), grid, color="#009e73")
    edges = np.geomspace(levels.min() * 0.999, levels.max() * 1.001, 7)
    for low, high in pairwise(edges):
        part = (levels >= low) & (levels < high)
        if part.any():
            fit.scatter(correct[part].mean(), np.sqrt(low * high), 6.0 * part.sum(), "0.4", alpha=0.7, linewidth=0)
    fit.set(xlabel="share of right answers", xlim=(0.4, 1.02))
    figure.suptitle(
        f"Threshold {threshold.value:.1f} %: three answers in four are right at that difference", fontsize=11
    )
    return figure


def main() -> None:
    """Read the options, and run a session."""
    parser = argparse.ArgumentParser(
        description="Force discrimination through the bridge, by an adaptive staircase."
    )
    parser.add_argument(
        "url", nargs="?", default="ws://127.0.0.1:8765", help="address that `tensionlab serve` prints"
    )
    parser.add_argument("--out", type=Path, required=True, help="new folder for tables, markers and figure")
    parser.add_argument("--subject", type=float, metavar="PERCENT", help="simulate a subject with this threshold")
    parser.add_argument("--trials", type=int, default=80)
    parser.add_argument("--standard", type=float, default=2.0, metavar="N", help="force of the standard, in N")
    parser.add_argument("--hold", type=float, default=1.0, metavar="S", help="duration of an interval, in s")
    parser.add_argument("--pause", type=float, default=0.5, metavar="S", help="time without force before it, in s")
    parser.add_argument("--seed", type=int, default=0, help="seed of the order and of a simulated subject")
    options = parser.parse_args()
    if options.out.exists():
        parser.error(f"{options.out} is there already; name a new folder")
    if options.hold <= 2.0 * SETTLING_S:
        parser.error(
            f"--hold is {options.hold:g}; give more than {2.0 * SETTLING_S:g} s, in which a force comes up"
        )
    try:
        run(options)
    except TensionlabError as error:
        raise SystemExit(f"{parser.prog}: {error}") from None


if __name__ == "__main__":
    main()
