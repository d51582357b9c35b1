"""``tensionlab module config``: parameters of modules, one by one or as a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.modules import call_all, exit_if_failed, find_links
from tensionlab.cli.common.options import Json, Links, ModulesFile
from tensionlab.errors import HardwareError
from tensionlab.files.reading import read_text
from tensionlab.files.writing import make_folder, write_text

if TYPE_CHECKING:
    from tensionlab.hardware.client.module import ModuleClient
    from tensionlab.hardware.client.parameter_file import Change

config = options.group("Get and set the parameters of modules. The modules must be idle.")
LinksAndParameters = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="URL|PARAMETER",
        help="Links to modules, or with --modules names of modules; and parameters.",
        show_default=False,
    ),
]
Save = Annotated[bool, typer.Option("--save", help="Store all parameters: they outlast the next start.")]


@config.command()
def get(words: LinksAndParameters = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Show parameters, such as slew or ttl; all of them if none is named."""
    from tensionlab.hardware.client.parameter_file import parameters, plain
    from tensionlab.hardware.protocol.parameters import PARAMETER_DESCRIPTIONS, PARAMETERS

    named = [word for word in words or () if word in PARAMETERS] or list(PARAMETERS)
    links = find_links([word for word in words or () if word not in PARAMETERS], modules)
    answers, failed = call_all(links, parameters)
    if json:
        output.print_json(
            [
                {"module": name, "url": links[name], "parameters": {each: found[each].value for each in named}}
                for name, found in answers.items()
            ]
        )
    elif answers:
        grid = output.table("", ("<parameter", *answers, "<unit"))
        if len(answers) == 1:
            grid.add_column("what it is")
        for each in named:
            values = (plain(found[each].value) for found in answers.values())
            about = [PARAMETER_DESCRIPTIONS[each]] if len(answers) == 1 else []
            grid.add_row(each, *values, PARAMETERS[each].unit, *about)
        output.console().print(grid)
    exit_if_failed(failed)


@config.command(name="set")
def set_(words: LinksAndParameters = None, modules: ModulesFile = None, save: Save = False) -> None:
    """Change parameters, such as slew=50 ttl=200, until the next start, or for good with --save."""
    from tensionlab.hardware.client.parameter_file import change, checked

    pairs = [word.partition("=") for word in words or () if "=" in word]
    if not pairs:
        raise typer.BadParameter("no parameters; write them like slew=50")
    values: dict[str, float] = {}
    for name, _, value in pairs:
        try:
            values[name] = float(value)
        except ValueError:
            raise typer.BadParameter(f"{name}={value}: give a number, such as {name}=50") from None
    checked(values, "set")
    links = find_links([word for word in words or () if "=" not in word], modules)
    _change(links, lambda client: change(client, values, "set"), save)


@config.command()
def dump(
    links: Links = None,
    modules: ModulesFile = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            callback=options.output_folder(),
            help="Write NAME.toml for each module to this folder; made if it is not there.",
        ),
    ] = None,
) -> None:
    """Print all parameters of a module as a file (TOML); those of several go to a folder."""
    from tensionlab.hardware.client.parameter_file import dump as text_of
    from tensionlab.hardware.client.parameter_file import file_of

    urls = find_links(links, modules)
    if folder is None and len(urls) > 1:
        raise typer.BadParameter("more than one module; give --folder DIRECTORY, for a file of each")
    if folder is not None and modules is None:
        raise typer.BadParameter("--folder needs --modules FILE, whose names the files get")
    texts, failed = call_all(urls, text_of)
    if folder is None:
        for text in texts.values():
            typer.echo(text, nl=False)
    else:
        make_folder(folder)
        with output.ResultWriter() as writer:
            for name, text in texts.items():
                file = file_of(folder, name)
                if writer.write("", file, partial(write_text, text=text)):
                    typer.echo(file)
            exit_if_failed(failed)
    exit_if_failed(failed)


@config.command()
def restore(
    path: Annotated[
        Path, typer.Argument(metavar="FILE", help="What dump wrote, or a part of it; a folder with --modules.")
    ],
    links: Links = None,
    modules: ModulesFile = None,
    save: Save = False,
) -> None:
    """Set the parameters of modules from a file, until the next start, or for good with --save.

    What the file does not name stays as it is. All values are checked before the first is changed. One file
    serves several modules; in a folder, each has its NAME.toml.
    """
    from tensionlab.hardware.client.parameter_file import change, file_of, parse

    urls = find_links(links, modules)
    files = {name: file_of(path, name) if path.is_dir() else path for name in urls}
    values = {
        name: parse(read_text(file, "a file of parameters (*.toml)", HardwareError), str(file))
        for name, file in files.items()
    }
    _change(urls, lambda client: change(client, values[client.name], str(files[client.name])), save)


def _change(links: Mapping[str, str], job: Callable[[ModuleClient], list[Change]], save: bool) -> None:
    """Change parameters of all modules, store them if ``save``, and print what changed."""
    from tensionlab.hardware.client.parameter_file import LENGTH_PARAMETERS, plain

    def change_and_save(client: ModuleClient) -> list[Change]:
        changes = job(client)
        if save:
            client.save()
        return changes

    answers, failed = call_all(links, change_and_save)
    for name, changes in answers.items():
        for each in changes:
            typer.echo(f"{name}: {each.name} {plain(each.before)} -> {plain(each.after)}")
        if not changes:
            typer.echo(f"{name}: nothing to change")
        if save:
            typer.echo(f"{name}: stored")
        if LENGTH_PARAMETERS & {each.name for each in changes}:
            typer.echo(f"{name}: it no longer knows how long its cable is; calibrate that")
    exit_if_failed(failed)
