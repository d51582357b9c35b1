"""All verbs of the command line."""

from collections.abc import Iterator
from typing import Any

import typer

from tensionlab.cli import app


def every_verb(group: Any = None, words: tuple[str, ...] = ()) -> Iterator[tuple[str, Any]]:
    """Yield the words that call each verb, and its command."""
    group = typer.main.get_command(app) if group is None else group
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        if hasattr(command, "commands"):
            yield from every_verb(command, (*words, name))
        if not getattr(command, "commands", None) or command.invoke_without_command:
            yield " ".join((*words, name)), command
