"""A serial port of Windows, below pyserial's own code for it: what that calls of the system ends here.

It does what is documented of `ReadFile` with overlapped results, `COMMTIMEOUTS` and `CancelIoEx`, for one reader.
"""

# ruff: noqa: N802 - names of the system

from __future__ import annotations

import ctypes
import functools
import importlib
import threading
from typing import Any

import pytest

ACCESS_DENIED, BROKEN = 5, 31
MAX_DWORD = 4294967295


class Port:
    """A port of the system: what the far end sent waits in `incoming`, what was sent to it is `written`."""

    def __init__(self) -> None:
        self.incoming, self.written, self.configured, self.last_error = b"", b"", 0, 0
        self.name, self.dcb, self.timeouts = "", None, None
        self.taken = self.unplugged = self._cancelled = False
        self._wanted, self._buffer = 0, None
        self._changed = threading.Condition()

    def come(self, content: bytes) -> None:
        """Let bytes arrive."""
        with self._changed:
            self.incoming += content
            self._changed.notify_all()

    def unplug(self) -> None:
        """Take the device away."""
        with self._changed:
            self.unplugged = True
            self._changed.notify_all()

    # What pyserial calls; what is not here succeeds

    def CreateFileW(self, name: str, *_: object) -> int:
        self.name, self.last_error = name, ACCESS_DENIED * self.taken
        return ctypes.c_void_p(-1).value if self.taken else 1

    def SetCommState(self, handle: int, dcb: Any) -> int:
        self.configured, self.dcb = self.configured + 1, dcb._obj
        return 1

    def SetCommTimeouts(self, handle: int, timeouts: Any) -> int:
        self.timeouts = getattr(timeouts, "_obj", timeouts)
        return 1

    def ClearCommError(self, handle: int, flags: Any, status: Any) -> int:
        status._obj.cbInQue = len(self.incoming)
        return self._works()

    def ReadFile(self, handle: int, buffer: Any, size: int, read: Any, overlapped: Any) -> int:
        assert self.dcb.fDtrControl == self.dcb.fRtsControl == 0, "a board would be reset"
        self._wanted, self._buffer, self._cancelled = size, buffer, False
        self.last_error = 997  # it is under way
        return 0

    def GetOverlappedResult(self, handle: int, overlapped: Any, count: Any, wait: bool) -> int:
        if not wait:
            self.last_error = 996  # it is not complete
            return int(self._buffer is None)
        seconds = 1e-3 * self.timeouts.ReadTotalTimeoutConstant
        assert seconds or self.timeouts.ReadIntervalTimeout == MAX_DWORD, "it would never return"
        with self._changed:
            self._changed.wait_for(self._ended, seconds)
            came, self.incoming = self.incoming[: self._wanted], self.incoming[self._wanted :]
        ctypes.memmove(self._buffer, came, len(came))
        count._obj.value, self._buffer = len(came), None
        if self._cancelled:
            self.last_error = 995
            return 0
        return self._works()

    def CancelIoEx(self, handle: int, overlapped: Any) -> int:
        with self._changed:
            self._cancelled = True
            self._changed.notify_all()
        return 1

    def WriteFile(self, handle: int, content: bytes, size: int, count: Any, overlapped: Any) -> int:
        self.written += content[:size]
        return self._works()

    def GetLastError(self) -> int:
        return self.last_error

    def _ended(self) -> bool:
        return len(self.incoming) >= self._wanted or self._cancelled or self.unplugged

    def _works(self) -> int:
        self.last_error = BROKEN * self.unplugged
        return int(not self.unplugged)


class Kernel32:
    """The system's library; its functions are those of `port`."""

    def __init__(self) -> None:
        self.port = Port()

    def __getattr__(self, name: str) -> Any:
        function = functools.partial(self._call, name)  # whose types of arguments can be set
        setattr(self, name, function)
        return function

    def _call(self, name: str, *arguments: Any) -> Any:
        return getattr(self.port, name, lambda *_: 1)(*arguments)


KERNEL32 = Kernel32()
with pytest.MonkeyPatch.context() as _patch:
    _patch.setattr(ctypes, "WinDLL", lambda name: KERNEL32, raising=False)
    serialwin32 = importlib.import_module("serial.serialwin32")


def as_on_windows(patch: pytest.MonkeyPatch) -> Port:
    """Let pyserial open ports as on Windows, all of them the one that this returns."""
    import serial

    KERNEL32.port = port = Port()
    patch.setattr(serial, "Serial", serialwin32.Serial)
    patch.setattr(ctypes, "WinError", lambda: OSError(port.last_error, "of Windows"), raising=False)
    return port
