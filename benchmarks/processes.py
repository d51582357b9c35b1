"""Modules and hosts in processes of their own, as `tensionlab simulate` and `tensionlab run` make them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager

from tensionlab.errors import HardwareError

ENDING = 60.0  # how long a process may take to end, in s, after the signal


def command(*words: object) -> list[str]:
    """Return the command line that calls ``tensionlab`` with this interpreter."""
    return [sys.executable, "-m", "tensionlab", *(str(word) for word in words)]


@contextmanager
def process(*words: object) -> Iterator[subprocess.Popen[str]]:
    """Run a verb of ``tensionlab`` in another process; kill it at the end if it still runs."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    pipe = subprocess.PIPE
    with subprocess.Popen(command(*words), stdout=pipe, stderr=pipe, text=True, env=environment) as running:
        try:
            yield running
        finally:
            running.kill()


@contextmanager
def simulated(*words: object) -> Iterator[tuple[dict[str, str], subprocess.Popen[str]]]:
    """Run ``tensionlab simulate``; gives the links by name, and the process.

    Raises
    ------
    HardwareError
        If it does not start, or does not end well after the signal (it may have ended before).
    """
    with process("simulate", *words) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        lines = [running.stdout.readline()]
        if lines != ["[modules]\n"]:
            raise HardwareError(f"tensionlab simulate did not start: {running.stderr.read()}")
        while lines[-1].strip():
            lines.append(running.stdout.readline())
        yield tomllib.loads("".join(lines))["modules"], running
        if running.poll() is not None:
            return
        running.send_signal(signal.SIGTERM)
        code, said = running.wait(ENDING), running.stderr.read()
        if code != 0 or "Traceback" in said:
            raise HardwareError(f"tensionlab simulate ended with {code}: {said}")
