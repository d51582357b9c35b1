"""An emergency stop from outside: of modules that nobody uses, and of those that another process has."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass

from tensionlab.errors import HardwareError, LinkError
from tensionlab.hardware.client.group import PATIENT_TIMEOUTS_S
from tensionlab.hardware.client.locks import ESTOP_SIGNAL, Holder, holder
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.messages import EmergencyStop

PATIENCE = 6.0
"""How long, in s, a process that was told may take to stop its modules and let go of their links."""
BREATH = 0.01
"""How often to look whether it has, in s."""


@dataclass(frozen=True)
class Outcome:
    """What became of a module?

    Attributes
    ----------
    holder : Holder or None
        The process that had it, and was told to stop all its modules; None if nobody had it.
    error : str
        Why the module did not confirm that it has let go; empty if it did.
    """

    holder: Holder | None
    error: str = ""


def emergency_stop(links: Mapping[str, str]) -> dict[str, Outcome]:
    """Have modules let go at once, whoever has them. Which confirmed it?

    Processes that have some of them are told first: `claims.ESTOP_SIGNAL`. The others are told here. As soon as a
    process lets go of its links, its modules are told again, and asked to confirm it.

    Parameters
    ----------
    links : mapping of str to str
        URLs by names.
    """
    holders = {name: holder(url) for name, url in links.items()}
    told: dict[int, str] = {}
    for who in holders.values():
        if who is not None and who.pid not in told:
            told[who.pid] = _tell(who)

    def one(name: str) -> Outcome:
        who = before = holders[name]
        end = time.monotonic() + (PATIENCE if who is not None and not told[who.pid] else 0.0)
        while True:
            try:
                with ModuleClient(name, links[name]) as client:
                    client.command(EmergencyStop(), PATIENT_TIMEOUTS_S)
                    return Outcome(who)
            except HardwareError as error:
                now = holder(links[name]) if isinstance(error, LinkError) else None
                # Who had it when this try began may have let go since: then it is free now.
                if (now is None and before is None) or time.monotonic() > end:
                    return Outcome(who, _why(error, who, now, told))
                before = now
            time.sleep(BREATH)

    with ThreadPoolExecutor(len(links)) as threads:
        return dict(zip(links, threads.map(one, links), strict=True))


def _tell(who: Holder) -> str:
    """Have a process stop its modules; why that cannot be, empty if it can."""
    if who.pid == os.getpid():
        return "this process has it"
    with suppress(ProcessLookupError):  # it has just ended
        try:
            os.kill(who.pid, ESTOP_SIGNAL)
        except PermissionError as error:
            return f"{who} cannot be told: {error.strerror}"
    return ""


def _why(error: HardwareError, who: Holder | None, now: Holder | None, told: Mapping[int, str]) -> str:
    if now is None:
        return str(error)
    if who is None:
        return f"{now} has just taken it; try again"
    if told[who.pid]:
        return told[who.pid]
    return f"{who} was told, and still has it; end it (kill -9 {who.pid}), and its modules let go"
