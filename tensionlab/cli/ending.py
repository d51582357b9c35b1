"""How a command ends: its exit status, one line for what went wrong, and streams that are closed or full."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from tensionlab.errors import MAX_MESSAGE_CHARACTERS, TensionlabError

if TYPE_CHECKING:
    from typing import TextIO

BAD_INPUT = 2
"""Exit status where input is bad, or a file or stdout cannot be written."""
INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 + SIGINT, as a shell has it."""
NOBODY_READS = 141
"""Exit status where whoever reads stdout has gone: 128 + SIGPIPE."""

ClickException: type[Any] = typer.BadParameter.__mro__[2]  # later versions of typer bring a click of their own
SCREENS = {"click", "typer", "rich"}
"""What prints on stdout. All else that writes names its file."""


def run(command: Callable[[Sequence[str]], object], words: Sequence[str]) -> int:
    """Run a command and return its exit status; what goes wrong is one line on stderr.

    Errors that are a defect of this program, such as a `TypeError`, are let through with their traceback.
    """
    _open_streams()
    status = _status(command, words)
    try:
        sys.stdout.flush()
    except OSError as error:
        status = _without_stdout(error)
    return status


def say(text: str) -> None:
    """Print one line about what went wrong on stderr: of limited length, with nothing that moves a cursor."""
    with suppress(OSError, ValueError):
        print(clipped(f"tensionlab: {text}"), file=sys.stderr, flush=True)


def clipped(text: str, length: int = MAX_MESSAGE_CHARACTERS) -> str:
    """Return a text as one line of so many characters at most; what is left out is in its middle."""
    line = "".join(each if each.isprintable() else repr(each)[1:-1] for each in " ".join(text.split()))
    if len(line) <= length:
        return line
    end = length // 3
    return f"{line[: length - end - 5]} ... {line[-end:]}"


def _status(command: Callable[[Sequence[str]], object], words: Sequence[str]) -> int:
    try:
        command(words)
        return 0
    except typer.Exit as leaving:
        return leaving.exit_code
    except KeyboardInterrupt:
        say("interrupted")
        return INTERRUPTED
    except typer.Abort:
        say("stdin ended before it was answered; run this in a terminal")
        return BAD_INPUT
    except ClickException as error:
        if len(error.message) > MAX_MESSAGE_CHARACTERS and type(error).__name__ != "NoArgsIsHelpError":
            error.message = clipped(error.message)
        with suppress(OSError):
            error.show()
        return int(error.exit_code)
    except TensionlabError as error:
        say(str(error))
    except OSError as error:
        return _system_refused(error)
    except MemoryError:
        say("out of memory; ask for less at once, such as fewer modules, poses or forces")
    except RecursionError as error:
        say(f"nested too deeply ({_where(error)}); give input that is less nested")
    except ValueError as error:
        say(f"{error} ({_where(error)})")
    return BAD_INPUT


def _system_refused(error: OSError) -> int:
    """Say what the system refused; it may be that nobody reads stdout."""
    innermost = traceback.extract_tb(error.__traceback__)[-1].filename
    if error.filename is None and SCREENS & set(Path(innermost).parts):
        return _without_stdout(error)
    place = "" if error.filename is None else f"{error.filename}: "
    say(f"{place}{error.strerror or error} ({_where(error)})")
    return BAD_INPUT


def _without_stdout(error: OSError) -> int:
    """Throw away what stdout does not take, lest the interpreter tries again at its end."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
    if isinstance(error, BrokenPipeError):
        return NOBODY_READS
    say(f"stdout cannot be written ({error.strerror or error})")
    return BAD_INPUT


def _where(error: BaseException) -> str:
    """Where in the code it came up, for who wants to report it."""
    frames = traceback.extract_tb(error.__traceback__)
    frame = next((each for each in reversed(frames) if "tensionlab" in each.filename), frames[-1])
    return f"{type(error).__name__} at {Path(frame.filename).name}:{frame.lineno}"


def _open_streams() -> None:
    """Have stdout and stderr, even where they were closed, and write all characters, even where they are ASCII."""
    for name in ("stdout", "stderr"):
        stream: TextIO | None = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 - until the end
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
