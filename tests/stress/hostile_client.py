"""Hostile clients against `tensionlab serve`, which must stay up, within limits, and at its rate.

``python -m tests.stress.hostile_client`` (or ``make hostile``) sends 100,000 messages, drawn by
hypothesis from the schema and around it, as JSON and over OSC, to a rig and to a scenario on simulated modules.
Floods, padding and garbage come in between. Hostile phases take turns with calm ones, so that the rate of the
loop is compared on the same machine, as busy as it is then.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.processes import process
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, HardwareError
from tensionlab.haptics.bridge.messages import MAX_MESSAGE_BYTES
from tensionlab.hardware.log.reader import read_run
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tests.stress.hostile_messages import datagrams, draw, texts

RIG = "bartels2026-validation"
ROUNDS = 4  # of a calm phase, JSON, OSC and floods
CALM_S, FLOOD_S = 6.0, 3.0
RATE = 50
OFTEN = 400.0  # messages a second, within what a client may send
WALL = {
    "wall": {"kind": "wall", "plane": {"point": [0.0, 0.3, 0.0], "normal": [0.0, 1.0, 0.0]}, "stiffness": 50.0}
}
LEAST_RATE = 0.9
ROUNDING_N = 1e-3  # telemetry carries tensions in four bytes
OSC_SILENCE_S = 5.5  # after this, who was silent has lost the command


@dataclass
class Tally:
    """What came of it: answers, reasons, ends of connections, rates by the kind of phase."""

    sent: Counter[str] = field(default_factory=Counter)
    answers: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)
    closed: Counter[str] = field(default_factory=Counter)
    rates: dict[str, list[float]] = field(default_factory=dict)
    gaps: dict[str, float] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    phase: str = "begin"

    def answer(self, text: str | bytes) -> None:
        """Note what the bridge says."""
        said = json.loads(text)
        self.answers[said["type"]] += 1
        if said["type"] == "refused":
            reason = said.get("reason", "")
            if not 0 < len(reason) <= MAX_MESSAGE_CHARACTERS:
                self.wrong.append(f"a refusal with the reason {reason!r}")
            self.reasons[reason.split(":")[0][:30]] += 1


class Watcher:
    """Notes the rates that the bridge tells, by the phase that is on. A thread."""

    def __init__(self, url: str, tally: Tally) -> None:
        self._url, self._tally = url, tally
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        from websockets.exceptions import ConnectionClosed, InvalidStatus
        from websockets.sync.client import connect

        with (
            suppress(ConnectionClosed, InvalidStatus, OSError),
            connect(f"{self._url}/events", compression=None) as line,
        ):
            phase = ""
            while True:
                event = json.loads(line.recv())
                if event.get("kind") != "rate":
                    continue
                if phase == self._tally.phase:  # a whole second of it
                    self._tally.rates.setdefault(phase, []).append(event["cycles"])
                    self._tally.gaps[phase] = max(event["gap"], self._tally.gaps.get(phase, 0.0))
                phase = self._tally.phase


class Speaker:
    """A client that commands, and comes back when it is sent away."""

    def __init__(self, url: str, tally: Tally) -> None:
        self._url, self._tally, self._held = url, tally, ExitStack()
        self._line: Any = None  # a connection

    def say(self, text: str) -> None:
        """Send a message, and read until its answer."""
        from websockets.exceptions import ConnectionClosed
        from websockets.sync.client import connect

        try:
            if self._line is None:
                line = connect(f"{self._url}/command", compression=None)
                self._line = self._held.enter_context(line)
                self._tally.answer(self._line.recv())
            self._line.send(text)
            while True:
                said = self._line.recv(timeout=20.0)
                self._tally.answer(said)
                if json.loads(said)["type"] in ("state", "refused"):
                    return
        except ConnectionClosed as gone:
            self._tally.closed[gone.rcvd.reason[:40] if gone.rcvd else "no reason"] += 1
            if gone.rcvd is None:
                self._tally.wrong.append(f"a connection ended without a reason, in {self._tally.phase}")
            self.close()
        except OSError as error:
            raise HardwareError(f"the server does not listen any more: {error}") from None

    def close(self) -> None:
        """Go."""
        self._held.close()
        self._line = None


def calm(speaker: Speaker, home: list[float], seconds: float) -> None:
    """Drive the rig as a game does."""
    began = time.monotonic()
    while (now := time.monotonic() - began) < seconds:
        hand = [home[0], home[1] + 0.02 * float(np.sin(2.0 * now)), *home[2:]]
        frame = {"type": "frame", "time": now, "bodies": {"hand": {"position": hand}}, "effects": WALL}
        speaker.say(json.dumps(frame))
        time.sleep(1.0 / RATE)


def flood(url: str, port: int, seconds: float, tally: Tally) -> None:
    """Send padding, as fast as it goes, and malformed datagrams; come back when the connection is closed."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    end = time.monotonic() + seconds
    padding = '{"type": "frame", "time": 0, "x": "' + "x" * (MAX_MESSAGE_BYTES - 100) + '"}'
    backwards = b"#bundle\0" + bytes(8) + b"\xff\xff\xff\xf0" + bytes(16)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        while time.monotonic() < end:
            with suppress(ConnectionClosed, OSError), connect(f"{url}/command", compression=None) as padded:
                while time.monotonic() < end:
                    padded.send(padding)
                    tally.sent["padding"] += 1
                    for _ in range(50):
                        line.sendto(backwards, ("127.0.0.1", port))
                        tally.sent["datagrams without sense"] += 1


def attack(what: tuple[str, ...], rig: Rig, count: int, draws: int, folder: Path) -> Tally:
    """Send so many messages to one server, and return a tally of what happened.

    Parameters
    ----------
    what : tuple of str
        That `serve` is to serve.
    rig : Rig
        The same.
    count : int
        Two thirds as JSON, one third over OSC.
    draws : int
        Number of the draw.
    folder : Path
        Gets the log.
    """
    tally, log = Tally(), folder / "hostile.mcap"
    log.unlink(missing_ok=True)
    with process("serve", *what, "--port", 0, "--osc", 0, "--rate", RATE, "--log", log) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        complaints: list[str] = []
        said = running.stderr
        listener = threading.Thread(target=lambda: complaints.extend(said), daemon=True)
        listener.start()
        url = running.stdout.readline().split("/command")[0]
        port = int(running.stdout.readline().split()[-1])
        Watcher(url, tally)
        speaker = Speaker(url, tally)
        for number in range(ROUNDS):
            try:
                a_round(speaker, url, port, rig, count // ROUNDS, draws + number, tally)
            except HardwareError as error:
                tally.wrong.append(f"round {number + 1}, {tally.phase}: {error}")
                with suppress(subprocess.TimeoutExpired):
                    running.wait(30.0)  # it says why
                break
            print(f"{' '.join(what)}: round {number + 1} of {ROUNDS}, {dict(tally.sent)}", flush=True)
        speaker.close()
        running.send_signal(signal.SIGINT)
        code = running.wait(30.0)
        listener.join(10.0)
    if code != 130:
        tally.wrong.append(f"the server ended with {code}: {''.join(complaints)[-1000:]}")
    if tracebacks := sum("Traceback" in complaint for complaint in complaints):
        tally.wrong.append(f"{tracebacks} tracebacks: {''.join(complaints)[-3000:]}")
    if log.exists():
        tally.wrong += beyond(log, rig)
    return tally


def a_round(speaker: Speaker, url: str, port: int, rig: Rig, count: int, number: int, tally: Tally) -> None:
    """Be calm, hostile in JSON, flood, and be hostile over OSC."""
    names, home = ["hand", *rig.frames], [float(each) for each in rig.home]
    messages = draw(texts(rig.dimension, names, home), count * 2 // 3, number)
    packets = draw(datagrams(rig.dimension, names, home), count - len(messages), number)
    calm(speaker, home, 1.0)  # until here the machine has drawn
    tally.phase = "calm"
    calm(speaker, home, CALM_S)
    tally.phase = "JSON"
    for message in messages:
        speaker.say(message)
        tally.sent["JSON"] += 1
        time.sleep(0.5 / OFTEN)
    speaker.close()
    tally.phase = "flood"
    flood(url, port, FLOOD_S, tally)
    tally.phase = "between"
    time.sleep(OSC_SILENCE_S)
    tally.phase = "OSC"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        for packet in packets:
            line.sendto(packet, ("127.0.0.1", port))
            tally.sent["OSC"] += 1
            time.sleep(1.0 / OFTEN)
    tally.phase = "between"
    time.sleep(OSC_SILENCE_S)


def beyond(log: Path, rig: Rig) -> list[str]:
    """Return descriptions of the tensions of a run that were outside the rig's limits."""
    run = read_run(log)
    lower, upper = rig.limits.lower, rig.limits.upper
    found = []
    for name, tensions in (("commanded", run.commanded), ("told", run.measured)):
        least = lower if name == "commanded" else np.zeros(rig.m)  # modules come up from nothing
        out = (tensions < least - ROUNDING_N) | (tensions > upper + ROUNDING_N)  # NaN: a module renders by itself
        if out.any():
            found.append(f"{int(out.sum())} tensions {name} beyond the limits, of {tensions.size}")
    return found


def report(name: str, tally: Tally) -> bool:
    """Print what came of it; True if all was well."""
    calm_rate = statistics.median(tally.rates.get("calm", [0.0]))
    print(f"{name}: sent {dict(tally.sent)}; answers {dict(tally.answers)}; closed {dict(tally.closed)}")
    print(f"  reasons: {dict(tally.reasons.most_common(12))}")
    for phase, rates in tally.rates.items():
        found, calm_rate = statistics.median(rates), max(calm_rate, 1e-9)
        print(
            f"  {phase}: {found:.1f} cycles a second (median of {len(rates)} s), {found / calm_rate:.0%} of calm, "
            f"longest gap {1e3 * tally.gaps[phase]:.0f} ms"
        )
        if phase in ("JSON", "OSC", "flood") and found < LEAST_RATE * calm_rate:
            tally.wrong.append(f"{phase}: the loop keeps {found / calm_rate:.0%} of its rate")
    for problem in tally.wrong:
        print(f"  {problem}", file=sys.stderr)
    return not tally.wrong


def main() -> None:
    """Attack from the command line; exit status 1 if something must not be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=int(os.environ.get("TENSIONLAB_HOSTILE", "100000")))
    options = parser.parse_args()
    from tensionlab.scenarios import load_scenario

    targets: list[tuple[tuple[str, ...], Rig]] = [
        ((RIG,), load_rig(RIG)),
        (("--scenario", "materials"), load_scenario("materials").rig),
    ]
    with tempfile.TemporaryDirectory() as folder:
        tallies = [
            attack(what, rig, options.count // 2, 1000 * index, Path(folder))
            for index, (what, rig) in enumerate(targets)
        ]
    well = [report(" ".join(what), tally) for (what, _), tally in zip(targets, tallies, strict=True)]
    raise SystemExit(0 if all(well) else 1)


if __name__ == "__main__":
    main()
