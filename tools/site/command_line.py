"""Pages of the command line, one a verb, from the commands themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from tensionlab.cli import VERBS, app

FOLDER = Path("docs/reference/generated/cli")


def section(command: Any, names: list[str], level: int) -> str:
    """Return the Markdown of a command and of those below it."""
    words = " ".join(["tensionlab", *names])
    context = command.make_context(names[-1], [], resilient_parsing=True)
    context.info_name = words
    usage = " ".join(command.collect_usage_pieces(context))
    text = [f"{'#' * level} {words}", (command.help or "").strip(), f"```text\n{words} {usage}\n```"]
    parameters = [record for each in command.params if (record := each.get_help_record(context))]
    arguments = [(f"{name}", about) for name, about in parameters if not name.startswith("-")]
    options = [(name, about) for name, about in parameters if name.startswith("-")]
    for title, records in (("Arguments", arguments), ("Options", options)):
        if records:
            lines = ["| `{}` | {} |".format(name.replace("|", "\\|"), escape(about)) for name, about in records]
            text.append("\n".join([f"| {title} | |", "| :-- | :-- |", *lines]))
    for name in getattr(command, "commands", {}):
        below = command.get_command(context, name)
        text.append(section(below, [*names, name], level + 1))
    return "\n\n".join(part for part in text if part)


def escape(text: str) -> str:
    """Return plain text for the cell of a Markdown table."""
    return "".join(f"\\{each}" if each in "\\|*_<>[]$" else each for each in " ".join(text.split()))


def pages() -> dict[str, str]:
    """Return the page of each verb."""
    group: Any = typer.main.get_command(app)
    context = group.make_context("tensionlab", ["solvers"], resilient_parsing=True)
    return {name: section(group.get_command(context, name), [name], 1) + "\n" for name in VERBS}


def write(app: Any) -> None:
    """Write the pages into the folder that `docs/reference/command-line.md` lists."""
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        path = folder / f"{name}.md"
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Connect to Sphinx, before it looks for pages."""
    app.connect("builder-inited", write, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
