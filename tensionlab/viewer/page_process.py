"""A process that serves the page of a run of this process, so that the run has nothing to do for it."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import suppress

from tensionlab.errors import HardwareError
from tensionlab.hardware.client.shared_telemetry import publisher
from tensionlab.support.operating_system import OWN_GROUP

_started: list[subprocess.Popen[str]] = []


def open_page() -> str:
    """Start a process with the page of what this process will run, which opens a browser; return the address.

    It ends by itself when the run has ended and no browser shows it any more.

    Raises
    ------
    HardwareError
        If the page cannot be served.
    """
    published = publisher()
    if published is None:
        raise HardwareError("there is no free UDP port at 127.0.0.1, over which the view would follow the run")
    command = [sys.executable, "-P", "-m", "tensionlab.viewer.live"]  # -P: nothing of the working directory
    page = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **OWN_GROUP)
    _started.append(page)  # which outlives the run
    assert page.stdin is not None
    assert page.stdout is not None
    with suppress(OSError), page.stdin:  # if it has ended already, its answer says so
        page.stdin.write(json.dumps({"port": published.port, "token": published.token}) + "\n")
    with page.stdout:
        line = page.stdout.readline()
    answer = json.loads(line) if line else {"error": "its process has ended at once"}
    if "error" in answer:
        raise HardwareError(f"the view cannot be opened: {answer['error']}")
    return str(answer["url"])
