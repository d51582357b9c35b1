"""Hostile clients of `tensionlab serve`, which must stay up, within limits, and at its rate: ``make hostile``.

Messages drawn by hypothesis from the schema and around it, as JSON and over OSC, go to a rig and to a scenario on
simulated modules. Floods, padding and garbage come in between. Hostile phases take turns with calm ones, so that
the rates of the loop are compared on the same machine under the same load.
"""

from __future__ import annotations

import argparse
import json
import signal
import socket
import statistics
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
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import connect

from benchmarks.processes import process
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, HardwareError
from tensionlab.haptics.bridge.messages import MAX_MESSAGE_BYTES
from tensionlab.hardware.log.reader import read_run
from tensionlab.model.files import load_rig
from tensionlab.model.rig import Rig
from tensionlab.scenarios import load_scenario
from tests.stress.hostile_messages import datagrams, draw, texts

RIG = "bartels2026-validation"
ROUNDS = 4  # of a calm phase, JSON, floods and OSC
CALM_S, FLOOD_S = 6.0, 3.0
RATE = 50
OFTEN = 400.0  # messages a second, within what a client may send
WALL = {
    "wall": {"kind": "wall", "plane": {"point": [0.0, 0.3, 0.0], "normal": [0.0, 1.0, 0.0]}, "stiffness": 50.0}
}
LEAST_RATE = 0.9  # of the loop in a hostile phase, as a share of that in calm ones
ROUNDING_N = 1e-3  # telemetry carries tensions in four bytes
GONE = ConnectionClosed, InvalidHandshake, OSError  # errors of a connection that ends
OSC_SILENCE_S = 5.5  # a client that is silent for this long has lost the command


@dataclass
class Tally:
    """Messages sent by kind, cycles in each second by phase, the phase that is on, and what went wrong."""

    sent: Counter[str] = field(default_factory=Counter)
    rates: dict[str, list[float]] = field(default_factory=dict)
    phase: str = "begin"
    wrong: list[str] = field(default_factory=list)

    def watch(self, url: str) -> None:
        """Note the rates that the bridge reports."""
        with (
            suppress(ConnectionClosed, InvalidHandshake, OSError),
            connect(f"{url}/events", compression=None) as line,
        ):
            phase = ""
            while True:
                event = json.loads(line.recv())
                if event.get("kind") != "rate":
                    continue
                if phase == self.phase:  # a whole second of it
                    self.rates.setdefault(phase, []).append(event["cycles"])
                phase = self.phase


class Speaker:
    """Client that commands, and connects again when it is disconnected."""

    def __init__(self, url: str, tally: Tally) -> None:
        self._url, self._tally, self._held = url, tally, ExitStack()
        self._line: Any = None  # a connection

    def say(self, text: str) -> None:
        """Send a message, and read until its answer."""
        try:
            if self._line is None:
                self._line = self._held.enter_context(connect(f"{self._url}/command", compression=None))
                self._line.recv()
            self._line.send(text)
            while (answer := json.loads(self._line.recv(timeout=20.0)))["type"] not in ("state", "refused"):
                pass
            reason = answer.get("reason", "state")
            if not 0 < len(reason) <= MAX_MESSAGE_CHARACTERS:
                self._tally.wrong.append(f"a refusal with the reason {reason!r}")
        except ConnectionClosed as closed:
            if closed.rcvd is None:
                self._tally.wrong.append(f"a connection ended without a reason, in {self._tally.phase}")
            self.close()
        except OSError as error:
            raise HardwareError(f"the server does not listen any more: {error}") from None

    def close(self) -> None:
        """End the connection."""
        self._held.close()
        self._line = None

    def drive(self, home: list[float], seconds: float) -> None:
        """Move the hand as a game does."""
        began = time.monotonic()
        while (now := time.monotonic() - began) < seconds:
            hand = [home[0], home[1] + 0.02 * float(np.sin(2.0 * now)), *home[2:]]
            frame = {"type": "frame", "time": now, "bodies": {"hand": {"position": hand}}, "effects": WALL}
            self.say(json.dumps(frame))
            time.sleep(1.0 / RATE)


def flood(url: str, port: int, seconds: float, tally: Tally) -> None:
    """Send padding and malformed datagrams as fast as possible; connect again when the connection is closed."""
    end = time.monotonic() + seconds
    padding = '{"type": "frame", "time": 0, "x": "' + "x" * (MAX_MESSAGE_BYTES - 100) + '"}'
    backwards = b"#bundle\0" + bytes(8) + b"\xff\xff\xff\xf0" + bytes(16)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        while time.monotonic() < end:
            with (
                suppress(ConnectionClosed, InvalidHandshake, OSError),
                connect(f"{url}/command", compression=None) as padded,
            ):
                while time.monotonic() < end:
                    padded.send(padding)
                    for _ in range(50):
                        line.sendto(backwards, ("127.0.0.1", port))
                    tally.sent["padding, and 50 malformed datagrams"] += 1


def attack(what: tuple[str, ...], rig: Rig, count: int, draws: int, folder: Path) -> Tally:
    """Send messages to a server of a rig or scenario, two thirds as JSON, one third over OSC; return the tally."""
    tally, log = Tally(), folder / "hostile.mcap"
    log.unlink(missing_ok=True)
    with process("serve", *what, "--port", 0, "--osc", 0, "--rate", RATE, "--log", log) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        complaints: list[str] = []
        errors = running.stderr
        listener = threading.Thread(target=lambda: complaints.extend(errors), daemon=True)
        listener.start()
        url = running.stdout.readline().split("/command")[0]
        running.stdout.readline()  # of the page and the schema
        port = int(running.stdout.readline().split()[-1])
        threading.Thread(target=tally.watch, args=(url,), daemon=True).start()
        speaker = Speaker(url, tally)
        try:
            for number in range(ROUNDS):
                play_round(speaker, url, port, rig, count // ROUNDS, draws + number, tally)
                print(f"{' '.join(what)}: round {number + 1} of {ROUNDS}, {dict(tally.sent)}", flush=True)
        except HardwareError as error:
            tally.wrong.append(f"{tally.phase}: {error}")
        speaker.close()
        running.send_signal(signal.SIGINT)
        code = running.wait(30.0)
        listener.join(10.0)
    if code != 130 or any("Traceback" in complaint for complaint in complaints):
        tally.wrong.append(f"the server ended with {code}: {''.join(complaints)[-3000:]}")
    if log.exists():
        tally.wrong += find_violations(log, rig)
    calm_rate = statistics.median(tally.rates.get("calm", [0.0]))
    for phase, rates in tally.rates.items():
        share = statistics.median(rates) / max(calm_rate, 1e-9)
        print(f"  {phase}: {statistics.median(rates):.1f} cycles a second, {share:.0%} of calm")
        if phase in ("JSON", "OSC", "flood") and share < LEAST_RATE:
            tally.wrong.append(f"{phase}: the loop keeps {share:.0%} of its rate")
    return tally


def play_round(speaker: Speaker, url: str, port: int, rig: Rig, count: int, number: int, tally: Tally) -> None:
    """Be calm, hostile in JSON, flood, and be hostile over OSC."""
    names, home = ["hand", *rig.frames], [float(each) for each in rig.home]
    messages = draw(texts(rig.dimension, names, home), count * 2 // 3, number)
    packets = draw(datagrams(rig.dimension, names, home), count - len(messages), number)
    speaker.drive(home, 1.0)  # until here the machine has drawn
    tally.phase = "calm"
    speaker.drive(home, CALM_S)
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


def find_violations(log: Path, rig: Rig) -> list[str]:
    """Return descriptions of the tensions of a run that were outside the rig's limits."""
    run, found = read_run(log), []
    lower, upper = rig.limits.lower, rig.limits.upper
    for name, tensions in (("commanded", run.commanded), ("reported", run.measured)):
        least = lower if name == "commanded" else np.zeros(rig.m)  # modules come up from nothing
        out = (tensions < least - ROUNDING_N) | (tensions > upper + ROUNDING_N)  # NaN: a module renders by itself
        if out.any():
            found.append(f"{int(out.sum())} tensions {name} outside the limits, of {tensions.size}")
    return found


def main() -> None:
    """Attack from the command line; exit status 1 if something went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000)
    count, wrong = parser.parse_args().count, []
    targets = (((RIG,), load_rig(RIG)), (("--scenario", "materials"), load_scenario("materials").rig))
    with tempfile.TemporaryDirectory() as folder:
        for index, (what, rig) in enumerate(targets):
            wrong += attack(what, rig, count // 2, 1000 * index, Path(folder)).wrong
    for problem in wrong:
        print(f"  {problem}", file=sys.stderr)
    raise SystemExit(1 if wrong else 0)


if __name__ == "__main__":
    main()
