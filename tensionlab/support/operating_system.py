"""Differences between operating systems: signals, processes, files that are open elsewhere, pseudo-terminals.

No other file asks which system this is, or uses what only some have: ``tests/test_imports.py`` holds that.
"""

from __future__ import annotations

import errno
import os
import platform
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")

# Longest wait on Windows for a file that another program has open, in s.
OPEN_ELSEWHERE_S = 1.0
RETRY_PERIOD_S = 0.01
NICENESS = 10  # priority of background processes
FIFO_PRIORITY = 40  # below that of the kernel's threads for interrupts (50), which bring the modules' reports
MCL_CURRENT = 1  # of mlockall: the pages of now; those that a run maps later may exceed a limit, and fail
KERNEL_THREADS = "TENSIONLAB_NUM_THREADS"  # environment variable with the number of threads of our kernels
LIBRARIES = ("OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "NUMEXPR_NUM", "RAYON_NUM", "VECLIB_MAXIMUM")
# Environment with one thread for each library, which reads it when it is loaded.
ONE_THREAD = dict.fromkeys([KERNEL_THREADS, *(f"{library}_THREADS" for library in LIBRARIES)], "1")

if sys.platform == "win32":
    INTERRUPT_SIGNALS: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM, signal.SIGBREAK)
    ENDING_SIGNALS = INTERRUPT_SIGNALS
    ESTOP_SIGNAL = signal.SIGTERM
    OWN_GROUP: dict[str, Any] = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
else:
    INTERRUPT_SIGNALS: tuple[signal.Signals, ...] = (signal.SIGINT, signal.SIGTERM)
    ENDING_SIGNALS = (*INTERRUPT_SIGNALS, signal.SIGHUP)
    ESTOP_SIGNAL = signal.SIGUSR1
    OWN_GROUP: dict[str, Any] = {"process_group": 0}
"""Signals by which a user ends a program; those, and that of a terminal that is closed; the signal that makes a
process stop its modules at once; and arguments of `subprocess.Popen` for a process that Ctrl-C does not reach.

`ESTOP_SIGNAL` ends a process without a handler, and on Windows any process, and so its links: then the modules
release their cables by themselves."""


def send_estop(pid: int) -> None:
    """Send `ESTOP_SIGNAL` to a process, unless it has ended; a `PermissionError` if it is not this user's."""
    with suppress(ProcessLookupError):
        try:
            os.kill(pid, ESTOP_SIGNAL)
        except OSError as error:
            if sys.platform != "win32" or error.errno != errno.EINVAL:  # as Windows says that there is none
                raise


def kill_command(pid: int) -> str:
    """Return the command by which a user kills a process."""
    return f"taskkill /f /pid {pid}" if sys.platform == "win32" else f"kill -9 {pid}"


def lower_priority() -> None:
    """Lower the priority of this process; on Windows, do nothing."""
    if sys.platform != "win32":
        os.nice(NICENESS)


def interrupt_main_thread() -> None:
    """Have a handler of `INTERRUPT_SIGNALS` run in the main thread, even while that waits for the system."""
    if sys.platform == "win32":
        signal.raise_signal(signal.SIGINT)  # the only one there that ends a sleep
    else:
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, signal.SIGTERM)


@contextmanager
def holding_interrupts() -> Iterator[None]:
    """Hold a Ctrl-C back until the end of this context, in the main thread.

    For imports of compiled modules: an interrupt makes some end the process, and some go on as if none had come.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    previous_handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous_handler)
        if came:
            signal.raise_signal(signal.SIGINT)


def retry_while_locked(act: Callable[[], Result]) -> Result:
    """Call what replaces, renames or removes a file, and return its result.

    Windows refuses that while another program, a reader or a virus scanner, has the file open: then it is tried
    again for `OPEN_ELSEWHERE_S`.
    """
    end = time.perf_counter() + OPEN_ELSEWHERE_S
    while True:
        try:
            return act()
        except PermissionError:
            if sys.platform != "win32" or time.perf_counter() > end:
                raise
        time.sleep(RETRY_PERIOD_S)


def user_folders() -> Iterator[Path]:
    """Yield folders for this user's processes to share, which may not be there yet, the quickest first.

    No variable of the environment moves them, but on Windows ``LOCALAPPDATA``. The first lies in memory and is
    there while the user is logged in; the second is there for services, too, one for each machine that has the
    same home.
    """
    if sys.platform == "win32":
        yield Path(os.environ.get("LOCALAPPDATA") or tempfile.gettempdir()) / "tensionlab"
        return
    import pwd

    runtime = Path(f"/run/user/{os.getuid()}")
    if runtime.is_dir():
        yield runtime / "tensionlab"
    with suppress(KeyError):  # a user without an entry
        home = pwd.getpwuid(os.getuid()).pw_dir
        yield Path(home, ".local", "state", "tensionlab", platform.node())


def is_private(folder: Path) -> bool:
    """Return whether a folder is this user's own and closed to others; on Windows, where it is inherited, True."""
    if sys.platform == "win32":
        return True
    status = folder.lstat()
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077


def opened_by_other_user(peer: Any, own: Any) -> bool:
    """Return whether another user, not root, opened a TCP connection within this machine.

    ``peer`` and ``own`` are the addresses of its other end and of that in this process, as sockets have them; any
    other object belongs to a pair of sockets of this process. Linux alone tells: elsewhere it is False. A
    connection that its other end has closed has no owner and counts as another user's.
    """
    if sys.platform != "linux" or not isinstance(own, tuple):
        return False
    ports, users = (f"{peer[1]:04X}", f"{own[1]:04X}"), set()
    for table in (Path("/proc/net/tcp"), Path("/proc/net/tcp6")):
        with suppress(FileNotFoundError):  # without IPv6
            for line in table.read_text(encoding="ascii").splitlines()[1:]:
                _, local, remote, state, *rest = line.split()
                if (local[-4:], remote[-4:]) == ports and state == "01":
                    users.add(int(rest[3]))
    return not users or not users <= {os.getuid(), 0}


def process_start(pid: int) -> int | None:
    """Return when a process started, in the kernel's ticks; None if there is none, or the system does not say.

    Together with its number it names one process: numbers are used again.
    """
    if sys.platform == "linux":
        with suppress(OSError, ValueError, IndexError):
            fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2]
            return int(fields.split()[19])
    return None


def reader_has_gone(error: OSError) -> bool:
    """Return whether an error of writing means that the pipe's reader has closed it."""
    return isinstance(error, BrokenPipeError) or (sys.platform == "win32" and error.errno == errno.EINVAL)


def usable_processors() -> list[int]:
    """Return the numbers of the processors that this process may use."""
    if sys.platform == "linux":
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


@contextmanager
def real_time(processor: int) -> Iterator[list[str]]:
    """Bind this thread to a processor, schedule it with `SCHED_FIFO`, and lock the memory of the process.

    Yields a clause for each of them: what was granted, or why it was refused and what to do. Linux alone has them.
    All are undone in the end. Threads that start meanwhile inherit the processor and the priority.
    """
    if sys.platform != "linux":
        yield ["real-time scheduling was refused: only Linux has it"]
        return
    import ctypes

    library = ctypes.CDLL(None, use_errno=True)
    usable, policy, parameter = os.sched_getaffinity(0), os.sched_getscheduler(0), os.sched_getparam(0)

    def lock_memory() -> None:
        if library.mlockall(MCL_CURRENT):
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))

    allow = "run as root, or give the user `{}` in /etc/security/limits.conf"
    steps: list[tuple[str, str, Callable[[], Any], Callable[[], Any]]] = [
        (f"processor {processor}", "choose another", lambda: os.sched_setaffinity(0, {processor}),
         lambda: os.sched_setaffinity(0, usable)),
        (f"SCHED_FIFO with priority {FIFO_PRIORITY}", allow.format(f"rtprio {FIFO_PRIORITY}"),
         lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY)),
         lambda: os.sched_setscheduler(0, policy, parameter)),
        ("locked memory", allow.format("memlock unlimited"), lock_memory, library.munlockall),
    ]  # fmt: skip
    outcome = []
    with ExitStack() as granted:
        for name, advice, request, undo in steps:
            try:
                request()
            except OSError as error:
                outcome.append(f"{name} was refused ({error.strerror}): {advice}")
            else:
                granted.callback(undo)
                outcome.append(name)
        yield outcome


def processors() -> int:
    """Return how many processors this process may use."""
    return len(usable_processors())


def processor_name() -> str:
    """Return the processor's model where the system tells it, else its architecture."""
    if sys.platform == "linux":
        with suppress(OSError):
            for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
