"""Errors that tensionlab raises, as a tree.

::

    TensionlabError
    ├── ShapeError (ValueError)              arrays whose shapes or entries cannot form a problem
    ├── InputError (ValueError)              an argument or option that makes no sense; names it
    ├── DataError (ValueError)               a file of data that cannot be used; names file, row and column
    ├── RigError (ValueError)                a rig that cannot exist; names file, module and key
    ├── UnknownSolver (LookupError)          a solver name that is not in the table
    ├── PluginError (ImportError)            a solver of another distribution that cannot be used; names both
    ├── SweepError (ValueError)              a sweep that cannot be made: rigs, poses, measures or store
    ├── EffectError (ValueError)             a haptic effect that cannot be; names it and its parameter
    ├── ScenarioError (ValueError)           a scenario that cannot be played; names its file and key
    ├── WriteError (OSError)                 a file that cannot be written; names it, and says what to do
    ├── MissingDependency (ImportError)      a library that is not installed; names the extra that brings it
    ├── Unreachable                          an allocation that is not exact; carries the evidence
    └── HardwareError                        what goes wrong with modules
        ├── ProtocolError                    a frame or message that cannot be sent, or was not understood
        ├── LinkError (OSError)              a link that cannot be opened, or broke; names its URL
        ├── LinkTimeout (TimeoutError)       a module that does not answer; names it
        ├── CalibrationError                 measurements that do not tell what they should; says which to add
        ├── LogError                         a log that cannot be written or read; names its file
        └── ModuleFault                      a module that refuses, or lets go; carries its name and the code
"""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import Any

MAX_MESSAGE_CHARACTERS = 300
"""Of what is said about one thing that went wrong, on a terminal or to a client."""


class TensionlabError(Exception):
    """The root of all errors that tensionlab raises on purpose."""


class ShapeError(TensionlabError, ValueError):
    """Arrays whose shapes do not fit together, or that hold NaN or infinity."""


class InputError(TensionlabError, ValueError):
    """Argument or option that makes no sense; the message names it and what is possible."""


class DataError(TensionlabError, ValueError):
    """File of data that cannot be used; the message names the file, and the row or column."""


class RigError(TensionlabError, ValueError):
    """A rig, or a rig file, that does not describe something one could build."""


class UnknownSolver(TensionlabError, LookupError):  # noqa: N818 - pinned name
    """A solver name that the table of solvers does not hold."""


class PluginError(TensionlabError, ImportError):
    """A solver that another distribution offers and that cannot be used; the message names the distribution."""


class SweepError(TensionlabError, ValueError):
    """A sweep that cannot be made; the message names the argument, or what is in the way of the store."""


class EffectError(TensionlabError, ValueError):
    """A haptic effect, or what keeps it stable, with parameters that make no sense; names both."""


class ScenarioError(TensionlabError, ValueError):
    """A scenario that cannot be played; names its file and key."""


class WriteError(TensionlabError, OSError):
    """A file that cannot be written; the message names it, and says why and what to do."""


class MissingDependency(TensionlabError, ImportError):  # noqa: N818 - pinned name
    """An optional library that is not installed; the message names the extra that brings it."""


class Unreachable(TensionlabError):  # noqa: N818 - pinned name
    """Not every wrench was rendered exactly.

    Attributes
    ----------
    allocation : tensionlab.Allocation
        The complete result, so that nothing is lost.
    """

    def __init__(self, message: str, allocation: Any) -> None:
        super().__init__(message, allocation)
        self.allocation = allocation

    def __str__(self) -> str:
        """Return the message alone; all arguments are kept so that the error can be sent between processes."""
        return str(self.args[0])


class HardwareError(TensionlabError):
    """The root of all that goes wrong with modules and the links to them."""


class ProtocolError(HardwareError):
    """A frame or a message that cannot be sent, or that was not understood."""


class LinkError(HardwareError, OSError):
    """A link that cannot be opened, or that has broken; the message names its URL."""


class LinkTimeout(HardwareError, TimeoutError):  # noqa: N818 - pinned name
    """A module that does not answer; the message names it and its link."""


class CalibrationError(HardwareError):
    """Measurements that do not tell what was to be calibrated; the message says what to measure instead."""


class LogError(HardwareError):
    """A log that cannot be written or read; the message names its file."""


class ModuleFault(HardwareError):  # noqa: N818 - pinned name
    """A module that refuses a command, or has let go.

    Attributes
    ----------
    module : str
        Its name.
    code : Code, Fault or State
        Why: what the refusal said, the faults it found, or the state it is in.
    """

    def __init__(self, message: str, module: str, code: IntEnum | IntFlag) -> None:
        super().__init__(message, module, code)
        self.module = module
        self.code = code

    def __str__(self) -> str:
        """Return the message alone; all arguments are kept so that the error can be sent between processes."""
        return str(self.args[0])
