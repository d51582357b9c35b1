"""Python scripts in processes of their own, and waiting for what they do."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

HANGS_S = 180.0  # only what hangs takes so long


def until(met, what="it"):
    """Wait until something is so, and return what it gives."""
    end = time.monotonic() + HANGS_S
    while not (found := met()):
        assert time.monotonic() < end, f"{what} never came"
        time.sleep(0.02)
    return found


@contextmanager
def running(script: str, *words: str) -> Iterator[subprocess.Popen[str]]:
    """A script that has said, by an empty line, that it is ready. It is killed at the end."""
    command = [sys.executable, "-c", script, *words]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "\n"
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()
