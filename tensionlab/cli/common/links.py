"""Links to the modules that a verb is about, as its words and a modules file name them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tensionlab.hardware.client.links import URL_KINDS, require_known
from tensionlab.hardware.client.locks import normalised
from tensionlab.hardware.client.modules_file import load_modules

Links = Annotated[
    list[str] | None,
    typer.Argument(metavar="URL", help="Links to modules; with --modules, names of modules.", show_default=False),
]
ModulesFile = Annotated[
    Path | None,
    typer.Option("--modules", metavar="FILE", help="Modules file (TOML): all of its modules, or those named."),
]


def find_links(words: list[str] | None, file: Path | None, *, look_up: bool = True) -> dict[str, str]:
    """Return the URLs of the modules that are meant, by their names. Without a file, a URL is its own name.

    Unless ``look_up`` is False, the names of hosts are looked up, to refuse two links to the same module.
    """
    if file is not None:
        links = load_modules(file)
        for word in words or ():
            if word not in links:
                raise typer.BadParameter(f"{file} has no module {word!r}; it has {', '.join(links)}")
        found = {name: links[name] for name in words or links}
    elif words:
        if files := [word for word in words if word.endswith(".toml")]:
            raise typer.BadParameter(f"{files[0]} is a modules file, not a link; give it as --modules {files[0]}")
        found = {url: url for url in words}
    else:
        raise typer.BadParameter(f"no modules; give --modules FILE, or links:\n{URL_KINDS}")
    if words and len(found) < len(words):
        raise typer.BadParameter("a module is there twice; give each once")
    for url in found.values():
        require_known(url)
    reached = [normalised(url) for url in found.values() if look_up and url != "sim:"]
    if len(set(reached)) < len(reached):
        raise typer.BadParameter("two of these links reach the same module; give each once")
    return found
