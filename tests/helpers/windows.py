"""This machine as a program finds Windows: what only others have is gone, and what only Windows has is there."""

from __future__ import annotations

# These look for the system as they are imported, and need what it really has.
import asyncio  # noqa: F401
import importlib.util
import os
import select
import signal
import subprocess
import sys
from types import ModuleType

import filelock  # noqa: F401
import pytest
import serial  # noqa: F401

LACKING = {
    os: (
        "getuid", "geteuid", "fork", "openpty", "ttyname", "mkfifo", "uname", "nice",
        "sched_getaffinity", "sched_setaffinity", "sched_setscheduler", "sched_getscheduler",
    ),
    select: ("poll", "epoll", "POLLIN", "POLLHUP"),
    signal: ("SIGHUP", "SIGUSR1", "SIGUSR2", "SIGKILL", "SIGALRM", "SIGPIPE", "pthread_kill", "setitimer"),
}  # fmt: skip
NOT_THERE = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty")
SIGBREAK = signal.Signals(21)  # its number on Windows; here that signal is not sent to tests


def pretend(patch: pytest.MonkeyPatch) -> None:
    """Make this process find Windows from now on; what has been imported has found something else."""
    patch.setattr(sys, "platform", "win32")
    for module, names in LACKING.items():
        for name in names:
            patch.delattr(module, name)
    for name in NOT_THERE:
        patch.setitem(sys.modules, name, None)
    patch.setattr(signal, "SIGBREAK", SIGBREAK, raising=False)
    patch.setattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0x200, raising=False)


def as_on_windows(patch: pytest.MonkeyPatch) -> ModuleType:
    """Return another `tensionlab.support.operating_system`, as it is on Windows."""
    from tensionlab.support import operating_system

    pretend(patch)
    spec = importlib.util.spec_from_file_location("operating_system_of_windows", operating_system.__file__)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
