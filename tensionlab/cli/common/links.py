"""Links to modules, as a verb's words and a modules file name them, and what is done with all modules at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from tensionlab.cli.common.output import if_interrupted, print_error, print_json
from tensionlab.cli.common.verbs import option
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.links import URL_KINDS, load_modules, require_known
from tensionlab.hardware.client.locks import normalised
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.support.formatting import format_count

if TYPE_CHECKING:
    from tensionlab.model.rig import Rig

Answer = TypeVar("Answer")
Links = Annotated[
    list[str] | None, typer.Argument(metavar="URL", help="Links to modules, or names with --modules.")
]
ModulesFile = Annotated[
    Path | None, option("FILE", "Modules file (TOML): all modules, or those named.", "--modules")
]


def find_links(words: list[str] | None, file: Path | None, *, look_up: bool = True) -> dict[str, str]:
    """Return the URLs of the named modules, by their names. Without a file, a URL is its own name.

    Unless ``look_up`` is False, the names of hosts are looked up, to refuse two links to the same module.
    """
    if file is not None:
        links = load_modules(file)
        for word in words or ():
            if word not in links:
                raise typer.BadParameter(f"{file} has no module {word!r}; it has {', '.join(links)}")
        urls = {name: links[name] for name in words or links}
    elif words:
        if files := [word for word in words if word.endswith(".toml")]:
            raise typer.BadParameter(f"{files[0]} is a modules file, not a link; give it as --modules {files[0]}")
        urls = {url: url for url in words}
    else:
        raise typer.BadParameter(f"no modules; give --modules FILE, or links:\n{URL_KINDS}")
    if words and len(urls) < len(words):
        raise typer.BadParameter("a module is there twice; give each once")
    for url in urls.values():
        require_known(url)
    reached = [normalised(url) for url in urls.values() if look_up and url != "sim:"]
    if len(set(reached)) < len(reached):
        raise typer.BadParameter("two of these links reach the same module; give each once")
    return urls


def links_of_rig(rig: Rig, modules: str) -> dict[str, str]:
    """Return the URL of each module of a rig, from the value of ``--modules``: a file, or links."""
    if modules.endswith(".toml"):
        return load_modules(modules)
    urls = [url.strip() for url in modules.split(",") if url.strip()]
    if len(urls) != rig.m:
        names = f"{rig.m} modules ({', '.join(module.name for module in rig.modules)})"
        mismatch = f"--modules has {format_count(len(urls), 'link')}, {rig.name} has {names}"
        raise typer.BadParameter(f"{mismatch}; give a link for each, or a file that ends in .toml")
    return {module.name: url for module, url in zip(rig.modules, urls, strict=True)}


def call_all(
    links: Mapping[str, str], job: Callable[[ModuleClient], Answer]
) -> tuple[dict[str, Answer], dict[str, HardwareError]]:
    """Carry out a job on all modules, each in a thread; return answers and errors by the modules' names."""

    def call(name: str) -> Answer | HardwareError:
        try:
            with ModuleClient(name, links[name]) as client:
                return job(client)
        except HardwareError as error:
            return error

    unknown = "which modules did it is not known; `tensionlab module info` shows how they are"
    with if_interrupted(unknown), ThreadPoolExecutor(len(links)) as threads:
        outcomes = dict(zip(links, threads.map(call, links), strict=True))
    failed = {name: outcome for name, outcome in outcomes.items() if isinstance(outcome, HardwareError)}
    return {name: outcome for name, outcome in outcomes.items() if not isinstance(outcome, HardwareError)}, failed


def print_all(
    links: Mapping[str, str],
    job: Callable[[ModuleClient], Answer],
    json: bool,
    to_json: Callable[[Answer | None], dict[str, Any]],
    show: Callable[[dict[str, Answer]], None],
) -> None:
    """Carry out a job on all modules, and print the answers; leave with exit status 1 if one failed.

    In JSON each module has its name, its URL, what ``to_json`` makes of its answer, and its error, or None.
    """
    answers, failed = call_all(links, job)
    if json:
        about = {name: {"module": name, "url": url, **to_json(answers.get(name))} for name, url in links.items()}
        print_json([{**about[name], "error": failed.get(name) and str(failed[name])} for name in links])
    elif answers:
        show(answers)
    exit_if_failed(failed)


def exit_if_failed(failed: Mapping[str, HardwareError]) -> None:
    """Print each error on a line, and leave with exit status 1 if there is one."""
    for name, error in failed.items():
        text = str(error)
        print_error(text if name in text else f"module {name!r}: {text}")
    if failed:
        raise typer.Exit(1)
