"""The page of a run of this process, served by a process beside it, so that the run has nothing to do for it."""

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
        raise HardwareError("the system gives no UDP port at 127.0.0.1, over which the view would hear of the run")
    words = [sys.executable, "-P", "-m", "tensionlab.viewer.live"]  # -P: nothing of the working directory
    page = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, **OWN_GROUP)
    _started.append(page)  # it outlives the run
    assert page.stdin is not None
    assert page.stdout is not None
    with suppress(OSError), page.stdin:  # it has ended already: then that is what it answers
        page.stdin.write(json.dumps({"port": published.port, "token": published.token}) + "\n")
    with page.stdout:
        answer = page.stdout.readline()
    said = json.loads(answer) if answer else {"error": "its process has ended at once"}
    if "error" in said:
        raise HardwareError(f"the view cannot be opened: {said['error']}")
    return str(said["url"])
