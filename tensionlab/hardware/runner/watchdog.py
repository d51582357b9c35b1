"""Watchdog and signals of a run: what does not return must not keep the modules pulling.

Three ways out, one after another. The run's thread is interrupted, which ends whatever Python does there. Where
that does not help, it is in a native call: the watchdog's own thread stops the modules and ends the process. Where
no thread of Python gets a turn any more, a native one ends the process: modules release as their links close.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from tensionlab import _native
from tensionlab.errors import HardwareError
from tensionlab.support.operating_system import ENDING_SIGNALS, ESTOP_SIGNAL, interrupt_main_thread

TICK_S = 0.02  # period of the checks; ticks are counted, not time: a process that got no time at all missed none
GRACE_S = 0.5  # time for the run's thread to leave what it was interrupted in
NATIVE_GRACE_S = 2.0  # time beyond a step for which Python may keep this thread waiting
ENDING_S = 30.0  # longest time to stop the modules and close the log before the process ends without it


class Watchdog:
    """Watchdog over steps of the thread that is in its context `watching`.

    In another thread, `interrupt` is called with the reason: it stops the modules at once and interrupts this one,
    if it can. Where that did not help, `end` is called, which ends the process.
    """

    def __init__(self, interrupt: Callable[[str], None], end: Callable[[str], None]) -> None:
        self._interrupt, self._end = interrupt, end
        self._step: tuple[str, float] | None = None  # name and longest duration in s; a new object for each step

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch the steps in this context."""
        self._watched, self._closed = threading.get_ident(), threading.Event()
        self._native = _native.Watchdog(
            "tensionlab: a native call keeps the interpreter and does not return, so the process ends; its "
            "modules release as their links close\n"
        )
        thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._closed.set()
            try:
                thread.join()
            finally:  # whatever signal comes now
                self._native.close()

    def begin(self, name: str, seconds: float) -> None:
        """Begin a step of at most ``seconds``; the step before ends."""
        self._step = (name, seconds)

    def rest(self) -> None:
        """End a step; none follows at once."""
        self._step = None

    def _watch(self) -> None:
        seen: tuple[str, float] | None = None
        ticks = 0
        while not self._closed.wait(TICK_S):
            step = self._step
            self._native.kick(NATIVE_GRACE_S + (0.0 if step is None else step[1]))
            if step is None or step is not seen:
                seen, ticks = step, 0
                continue
            ticks += 1
            if ticks * TICK_S > step[1]:
                self._expire(*step)
                return

    def _expire(self, name: str, seconds: float) -> None:
        place = ""  # where the watched thread is, as far as Python knows
        if (frame := sys._current_frames().get(self._watched)) is not None:
            place = f", in {frame.f_code.co_name} ({Path(frame.f_code.co_filename).name}:{frame.f_lineno})"
        why = f"{name} has not ended for {seconds:g} s{place}: all modules are stopped"
        self._interrupt(why)
        for _ in range(round(GRACE_S / TICK_S)):
            self._native.kick(GRACE_S + NATIVE_GRACE_S)
            if self._closed.wait(TICK_S):
                return
        self._native.kick(ENDING_S)
        self._end(why)


EMERGENCY_STOPPED = "emergency stop; `tensionlab module clear` leads out of it"
STOPPING_SIGNALS = (*ENDING_SIGNALS, ESTOP_SIGNAL)  # signals that end a run, after its modules are stopped


class Interrupted(KeyboardInterrupt):
    """End by a signal, by its number; the message is the signal's name, or how the modules were stopped."""

    def __init__(self, number: int, message: str = "") -> None:
        super().__init__(message or signal.Signals(number).name)
        self.number = number


class Hung(BaseException):
    """End of a run by its watchdog. No `Exception`, so that code that catches those does not see it."""


class Interrupts:
    """Handler that turns the first signal into `Interrupted`; those after it do not disturb the orderly end."""

    def __init__(self) -> None:
        self._ignoring = False
        self._catching = False
        self._hung: Hung | None = None

    @contextmanager
    def caught(self, numbers: tuple[int, ...]) -> Iterator[None]:
        """Catch these signals in the context. Only the main thread can; elsewhere nothing is caught."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        previous_handlers = {number: signal.signal(number, self._take) for number in set(numbers)}
        self._catching = True
        try:
            yield
        finally:
            self._catching = False
            for number, handler in previous_handlers.items():
                signal.signal(number, handler)

    def ignore(self) -> None:
        """Let nothing interrupt from now on."""
        self._ignoring = True

    def throw(self, hung: Hung) -> None:
        """Raise an error in the main thread, from another thread, even while it waits for the system."""
        if self._catching:
            self._hung = hung
            interrupt_main_thread()

    def _take(self, number: int, frame: FrameType | None) -> None:
        if not self._ignoring:
            self._ignoring = True
            raise Interrupted(number) if self._hung is None else self._hung


@contextmanager
def stopping(stop: Callable[[], None], stop_at_once: Callable[[], None]) -> Iterator[None]:
    """Call `stop` in the end, also after errors, Ctrl-C, and signals that would end the program.

    ``tensionlab estop`` has `stop_at_once` called. Errors of stopping are raised only where there is no other; an
    `Interrupted` has them in its message.
    """
    interrupts = Interrupts()
    with interrupts.caught(STOPPING_SIGNALS):
        try:
            yield
        except BaseException as error:
            interrupts.ignore()
            at_once = isinstance(error, Interrupted) and error.number == ESTOP_SIGNAL
            outcome = EMERGENCY_STOPPED if at_once else "modules are stopped"
            try:
                (stop_at_once if at_once else stop)()
            except HardwareError as refused:
                outcome = f"NOT CONFIRMED that modules are stopped: {refused}"
            if isinstance(error, Interrupted):
                raise Interrupted(error.number, outcome) from None
            raise
        interrupts.ignore()
        stop()
