"""Errors that tensionlab raises on purpose: `TensionlabError`, and those of modules, `HardwareError`, below it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum, IntFlag
from typing import Any

MAX_MESSAGE_CHARACTERS = 300  # length of a message about one problem, on a terminal or to a client


class TensionlabError(Exception):
    """Base class of all errors that tensionlab raises on purpose.

    The message is the first argument; all are kept, so that an error can be sent between processes.

    Examples
    --------
    >>> import tensionlab as tl
    >>> try:
    ...     tl.load_rig("no-such-rig")
    ... except tl.errors.TensionlabError as error:
    ...     print(type(error).__name__)
    RigError
    """

    def __str__(self) -> str:
        return str(self.args[0]) if self.args else ""


class ShapeError(TensionlabError, ValueError):
    """Arrays whose shapes do not fit together, or that hold NaN or infinity."""


class InputError(TensionlabError, ValueError):
    """Invalid argument or option; the message names it and what is possible."""


class DataError(TensionlabError, ValueError):
    """Data file that cannot be used; the message names the file, and the row or column."""


class RigError(TensionlabError, ValueError):
    """Invalid rig or rig file; the message names file, module and key."""


class UnknownSolver(TensionlabError, LookupError):  # noqa: N818 - pinned name
    """Solver name that is not in the table of solvers."""


class PluginError(TensionlabError, ImportError):
    """Solver of another distribution or module that cannot be used; the message names where it is from."""


class SweepError(TensionlabError, ValueError):
    """Sweep that cannot be computed; the message names the argument, or the problem of its store."""


class EffectError(TensionlabError, ValueError):
    """Haptic effect, or what keeps it stable, with parameters that make no sense; names both."""


class ScenarioError(TensionlabError, ValueError):
    """Scenario that cannot be played; names its file and key."""


class WriteError(TensionlabError, OSError):
    """File that cannot be written; the message names it, and says why and what to do."""


class MissingDependency(TensionlabError, ImportError):  # noqa: N818 - pinned name
    """Optional library that is not installed; the message names the extra to install."""


@contextmanager
def optional_import(extra: str, what: str) -> Iterator[None]:
    """Import optional libraries in this context; one that is missing is a `MissingDependency`.

    ``extra`` is the extra of this package that brings them, ``what`` needs them.
    """
    try:
        yield
    except ModuleNotFoundError as missing:
        raise MissingDependency(f'{what} needs {missing.name}: pip install "tensionlab[{extra}]"') from missing


class Unreachable(TensionlabError):  # noqa: N818 - pinned name
    """Allocation that does not render every wrench exactly; ``allocation`` is the complete result."""

    def __init__(self, message: str, allocation: Any) -> None:
        super().__init__(message, allocation)
        self.allocation = allocation


class HardwareError(TensionlabError):
    """Base class of the errors of modules and their links."""


class ProtocolError(HardwareError):
    """Frame or message that cannot be sent or decoded."""


class LinkError(HardwareError, OSError):
    """Link that cannot be opened, or that has broken; the message names its URL."""


def cannot_listen(who: str, host: str, port: int, reason: OSError | str) -> HardwareError:
    """Return the error of what cannot listen at an address; the reason without the address, which is there."""
    if isinstance(reason, OSError):
        number = reason.errno or 0  # below zero where a name is not known, and large on Windows
        reason = os.strerror(number) if 0 < number < 1000 else str(reason.strerror or reason).partition(" (")[0]
    return HardwareError(
        f"{who} cannot listen at {host}, port {port}: {reason}; give another port, 0 for a free one, or another "
        "address"
    )


class LinkTimeout(HardwareError, TimeoutError):  # noqa: N818 - pinned name
    """Module that does not answer; the message names it and its link."""


class CalibrationError(HardwareError):
    """Measurements that do not determine what was to be calibrated; the message says what to measure instead."""


class LogError(HardwareError):
    """Log that cannot be written or read; the message names its file."""


class ModuleFault(HardwareError):  # noqa: N818 - pinned name
    """Module that refuses a command, or has released its cable.

    ``module`` is its name; ``code`` says why: the `Code` of the refusal, the `Fault` it found, or its `State`.
    """

    def __init__(self, message: str, module: str, code: IntEnum | IntFlag) -> None:
        super().__init__(message, module, code)
        self.module = module
        self.code = code
