"""The stop button of a run's page: the emergency stop of its modules, and its outcome."""

from __future__ import annotations

import time
from dataclasses import dataclass

from tensionlab.errors import HardwareError
from tensionlab.hardware.client.emergency_stop import RELEASE_TIMEOUT_S, emergency_stop
from tensionlab.hardware.sharing import RunWatcher
from tensionlab.support.formatting import format_count
from tensionlab.support.operating_system import kill_command, send_estop

POLL_PERIOD_S = 0.02
IN_PROCESS = "sim:"  # URL of a module that is simulated in the process of the run
OVER = ("ended", "gone")  # conditions of a run whose simulated modules pull no more


@dataclass(frozen=True)
class StopOutcome:
    """Outcome of a stop: whether all modules have confirmed it, and a line on each that has not, or on all."""

    confirmed: bool
    lines: tuple[str, ...]


def stop_modules(watcher: RunWatcher) -> StopOutcome:
    """Stop the modules of a run by an emergency stop, and wait for what comes of it.

    Modules that are simulated in the process of the run have no link of their own: that process is signalled
    to stop them, and reports that it did to the watcher, which must be polled meanwhile.
    """
    info = watcher.info
    if info is None:
        return StopOutcome(False, ("which modules there are is not known yet",))
    links = {name: url for name, url in info.links.items() if url != IN_PROCESS}
    try:
        outcomes = emergency_stop(links) if links else {}
    except HardwareError as error:
        return StopOutcome(False, (str(error),))
    wrong = [f"{name}: {each.error}" for name, each in outcomes.items() if each.error]
    if len(links) < len(info.links) and (problem := _stop_process(watcher, info.pid)):
        wrong.append(problem)
    if wrong:
        others = sum(not each.error for each in outcomes.values())
        return StopOutcome(False, (*wrong, f"confirmed by {format_count(others, 'module')}"))
    return StopOutcome(True, (f"confirmed by {format_count(len(info.links), 'module')}",))


def _stop_process(watcher: RunWatcher, pid: int) -> str:
    """Tell a process to stop its simulated modules; return why that is not confirmed, empty if it is."""
    if watcher.condition not in OVER:
        try:
            send_estop(pid)
        except PermissionError as error:
            return f"process {pid} cannot be signalled: {error.strerror}"
    end = time.perf_counter() + RELEASE_TIMEOUT_S
    while watcher.condition not in OVER:
        if time.perf_counter() > end:
            return (
                f"process {pid} was signalled and has not reported that its modules stopped; "
                f"end it ({kill_command(pid)}), and its simulated modules with it"
            )
        time.sleep(POLL_PERIOD_S)
    unconfirmed = {} if watcher.report is None else watcher.report.unconfirmed
    return "; ".join(f"{name}: {why}" for name, why in unconfirmed.items())
