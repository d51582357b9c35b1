"""Emergency stop of modules, whether they are free or in use by another process."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from tensionlab.errors import HardwareError, LinkError
from tensionlab.hardware.client.links import open_link
from tensionlab.hardware.client.locks import Holder, holder, locked_links
from tensionlab.hardware.client.module import PATIENT_TIMEOUTS_S, ModuleClient
from tensionlab.hardware.protocol.messages import EmergencyStop
from tensionlab.support.operating_system import kill_command, send_estop

RELEASE_TIMEOUT_S = 6.0  # longest wait for a signalled process to stop its modules and close their links
POLL_PERIOD_S = 0.01


@dataclass(frozen=True)
class Outcome:
    """Result for a module: the process that had it, if any, and why it did not confirm; empty if it did."""

    holder: Holder | None
    error: str = ""


def emergency_stop(links: Mapping[str, str]) -> dict[str, Outcome]:
    """Have modules, URLs by name, release their cables at once, whichever process uses them.

    Processes that use some of them get `ESTOP_SIGNAL` before any host name is looked up. Modules are commanded as
    soon as their links are free, each in a thread. Links are opened without a lock, so neither a full disk nor
    another user's folder prevents it.
    """
    signals = _Signals()
    owners = locked_links()
    holders = {name: owners.get(url) or holder(url, look_up=False) for name, url in links.items()}
    for owner in holders.values():
        if owner is not None:
            signals.send(owner)
    with ThreadPoolExecutor(len(links)) as threads:
        outcomes = threads.map(lambda name: _stop_module(name, links[name], holders[name], signals), links)
        return dict(zip(links, outcomes, strict=True))


def _stop_module(name: str, url: str, owner: Holder | None, signals: _Signals) -> Outcome:
    """Command a module as soon as the process that has its link, if any, has closed it."""
    previous_holder, end = owner, time.perf_counter() + RELEASE_TIMEOUT_S
    while True:
        try:
            _command(name, url)
            return Outcome(owner)
        except HardwareError as error:
            now = holder(url)  # by another name of the host, or since just now
            owner = owner or now
            problem = signals.send(now) if now is not None else ""
            if (now is None and previous_holder is None) or problem or time.perf_counter() > end:
                if now is not None and not problem:
                    end_it = kill_command(now.pid)
                    problem = f"{now} was signalled, and still has it; end it ({end_it}), and its modules stop"
                return Outcome(owner, problem or str(error))
            previous_holder = now  # it may have closed the link since this try began: then the link is free now
        time.sleep(POLL_PERIOD_S)


def _command(name: str, url: str) -> None:
    """Command a module whose link is free to stop, and wait until it confirms it; else a `HardwareError`."""
    if (owner := holder(url, look_up=False)) is not None:
        raise LinkError(f"{url} is in use by {owner}")
    with ModuleClient(name, open_link(url, locked=False)) as client:
        client.command(EmergencyStop(), PATIENT_TIMEOUTS_S)


class _Signals:
    """Signals of one emergency stop, at most one to each process."""

    def __init__(self) -> None:
        self._problems: dict[int, str] = {}
        self._sending = threading.Lock()

    def send(self, owner: Holder) -> str:
        """Signal a process to stop its modules, once; return why that failed, empty if it did not."""
        with self._sending:
            if owner.pid not in self._problems:
                self._problems[owner.pid] = "this process has it" if owner.pid == os.getpid() else ""
                try:
                    if owner.pid != os.getpid():
                        send_estop(owner.pid)
                except PermissionError as error:
                    self._problems[owner.pid] = f"{owner} cannot be signalled: {error.strerror}"
            return self._problems[owner.pid]
