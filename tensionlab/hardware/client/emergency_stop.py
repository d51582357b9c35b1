"""Emergency stop from outside: of free modules, and of those that another process uses."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from tensionlab.errors import HardwareError
from tensionlab.hardware.client.group import PATIENT_TIMEOUTS_S
from tensionlab.hardware.client.locks import Holder, holder
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.messages import EmergencyStop
from tensionlab.operating_system import kill_command, send_estop

RELEASE_TIMEOUT_S = 6.0
"""How long a signalled process may take to stop its modules and close their links."""
POLL_PERIOD_S = 0.01


@dataclass(frozen=True)
class Outcome:
    """Result for a module: the process that had it, if any, and why it did not confirm; empty if it did."""

    holder: Holder | None
    error: str = ""


def emergency_stop(links: Mapping[str, str]) -> dict[str, Outcome]:
    """Make modules, URLs by name, release their cables at once, whichever process uses them.

    Processes that use some of them get `ESTOP_SIGNAL` first. Modules are commanded from here as soon as
    their links are free, and confirm it.
    """
    holders = {name: holder(url) for name, url in links.items()}
    problems: dict[int, str] = {}
    for who in holders.values():
        if who is not None and who.pid not in problems:
            problems[who.pid] = _signal(who)

    def one(name: str) -> Outcome:
        who = before = holders[name]
        end = time.perf_counter() + (RELEASE_TIMEOUT_S if who is not None and not problems[who.pid] else 0.0)
        while True:
            try:
                with ModuleClient(name, links[name]) as client:
                    client.command(EmergencyStop(), PATIENT_TIMEOUTS_S)
                    return Outcome(who)
            except HardwareError as error:
                now = holder(links[name])
                # The process that had it when this try began may have closed it since: then it is free now.
                if (now is None and before is None) or time.perf_counter() > end:
                    return Outcome(who, _reason(error, who, now, problems))
                before = now
            time.sleep(POLL_PERIOD_S)

    with ThreadPoolExecutor(len(links)) as threads:
        return dict(zip(links, threads.map(one, links), strict=True))


def _signal(who: Holder) -> str:
    """Signal a process to stop its modules; return why that failed, empty if it did not."""
    if who.pid == os.getpid():
        return "this process has it"
    try:
        send_estop(who.pid)
    except PermissionError as error:
        return f"{who} cannot be signalled: {error.strerror}"
    return ""


def _reason(error: HardwareError, who: Holder | None, now: Holder | None, problems: Mapping[int, str]) -> str:
    if now is None:
        return str(error)
    if who is None:
        return f"{now} has just taken it; try again"
    if problems[who.pid]:
        return problems[who.pid]
    return f"{who} was signalled, and still has it; end it ({kill_command(who.pid)}), and its modules stop"
