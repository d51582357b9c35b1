"""What the verbs for modules share: which modules are meant, all of them at the same time, and what went wrong."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from tensionlab.cli.ending import say

if TYPE_CHECKING:
    from tensionlab.errors import HardwareError
    from tensionlab.hardware.client.module import ModuleClient

Answer = TypeVar("Answer")
Words = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[URL...]", help="Links to modules; with --modules, names of them.", show_default=False
    ),
]
ModulesFile = Annotated[
    Path | None,
    typer.Option("--modules", metavar="FILE", help="Modules file (TOML); all of them if none is named."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")]


def targets(words: list[str] | None, file: Path | None) -> dict[str, str]:
    """Which modules are meant: their URLs by their names. Without a file, a URL is its own name.

    Raises
    ------
    BadParameter
        For a name that the file does not have, for a module that is there twice, and if none is meant.
    LinkError
        For what is no URL.
    """
    from tensionlab.hardware.client.links import KINDS, require_known
    from tensionlab.hardware.client.locks import normalised
    from tensionlab.hardware.client.modules_file import load_modules

    if file is not None:
        links = load_modules(file)
        for word in words or ():
            if word not in links:
                raise typer.BadParameter(f"{file} has no module {word!r}; it has {', '.join(links)}")
        found = {name: links[name] for name in words or links}
    elif words:
        found = {url: url for url in words}
    else:
        raise typer.BadParameter(f"no modules; give --modules FILE, or links:\n{KINDS}")
    if words and len(found) < len(words):
        raise typer.BadParameter("a module is there twice; give each once")
    for url in found.values():
        require_known(url)
    reached = [normalised(url) for url in found.values() if url != "sim:"]
    if len(set(reached)) < len(reached):
        raise typer.BadParameter("two of these links reach the same module; give each once")
    return found


def on_all(
    links: Mapping[str, str], job: Callable[[ModuleClient], Answer]
) -> tuple[dict[str, Answer], dict[str, HardwareError]]:
    """What does each module answer, and where did it go wrong? All are asked at the same time.

    Parameters
    ----------
    links : mapping of str to str
        What `targets` gave.
    job : callable
        What to do with each module; called from a thread of its own.
    """
    from concurrent.futures import ThreadPoolExecutor

    from tensionlab.errors import HardwareError
    from tensionlab.hardware.client.module import ModuleClient

    answers: dict[str, Answer] = {}
    failed: dict[str, HardwareError] = {}

    def one(name: str) -> None:
        try:
            with ModuleClient(name, links[name]) as client:
                answers[name] = job(client)
        except HardwareError as error:
            failed[name] = error

    with ThreadPoolExecutor(len(links)) as threads:
        list(threads.map(one, links))
    return {name: answers[name] for name in links if name in answers}, {
        name: failed[name] for name in links if name in failed
    }


@contextmanager
def until_interrupted() -> Iterator[Callable[[], bool]]:
    """Let Ctrl-C, and SIGTERM, end a measurement in good order: whether one has come."""
    came: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda number, _: came.append(number)) for number in numbers]
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def complain(failed: Mapping[str, HardwareError]) -> None:
    """Say where it went wrong, a line each, and leave with exit status 1 if it did anywhere."""
    for name, error in failed.items():
        text = str(error)
        say(text if name in text else f"module {name!r}: {text}")
    if failed:
        raise typer.Exit(1)
