"""Ctrl-C, a killed program, a closed terminal: each ends a run in good order, and none disturbs that."""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)
"""What ends a program."""


class Interrupted(KeyboardInterrupt):
    """A signal ended the run.

    Attributes
    ----------
    number : int
        Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


class Hung(BaseException):
    """What the run's thread did was taking too long. No `Exception`: whoever catches those does not see it."""


class Interrupts:
    """Turns signals into `Interrupted`, once; those that come after it are remembered only.

    A demand or a solver that does not come back is left that way, and the orderly end is not.
    """

    def __init__(self) -> None:
        self._deaf = False
        self._catching = False
        self._hung: Hung | None = None

    @contextmanager
    def caught(self, numbers: tuple[int, ...]) -> Iterator[None]:
        """Catch these signals for a while. Only the main thread can; elsewhere nothing is caught."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = {number: signal.signal(number, self._take) for number in numbers}
        self._catching = True
        try:
            yield
        finally:
            self._catching = False
            for number, handler in before.items():
                signal.signal(number, handler)

    def ignore(self) -> None:
        """From now on, let nothing interrupt."""
        self._deaf = True

    def throw(self, hung: Hung) -> None:
        """Raise an error in the main thread, from another one, even while it waits for the system."""
        if not self._catching:
            return
        self._hung = hung
        if hasattr(signal, "pthread_kill"):
            main = threading.main_thread().ident
            assert main is not None
            signal.pthread_kill(main, signal.SIGTERM)
        else:
            _thread.interrupt_main(signal.SIGTERM)

    def _take(self, number: int, frame: FrameType | None) -> None:
        if not self._deaf:
            self._deaf = True
            raise Interrupted(number) if self._hung is None else self._hung
