"""``tensionlab estop``. It imports little, for the sake of time."""

from __future__ import annotations

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.links import Links, ModulesFile, find_links
from tensionlab.cli.common.verbs import Json
from tensionlab.hardware.client.emergency_stop import emergency_stop
from tensionlab.hardware.client.locks import locked_links


@output.if_interrupted("NOT CONFIRMED that all have stopped; the same command again, or cut the motors' supply")
def estop(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Stop modules at once, also those of other processes.

    They stay stopped until ``tensionlab module clear``. Without links and file: all modules that your processes
    use on this computer. Each such process gets some seconds to stop and release its modules; then each module has
    to confirm. Exit status 1 if one did not.

    This is software. Whatever it says, only cutting the motors' supply protects.
    """
    if links or modules is not None:
        urls = find_links(links, modules, look_up=False)
        names = {name: name for name in urls}
    else:
        held = locked_links()
        urls = {url: url for url in held}
        names = {url: who.module or url for url, who in held.items()}
    outcomes = emergency_stop(urls) if urls else {}
    if json:
        output.print_json(
            [
                {
                    "module": names[name],
                    "url": urls[name],
                    "confirmed": not each.error,
                    "process": each.holder and each.holder.pid,
                    "error": each.error or None,
                }
                for name, each in outcomes.items()
            ]
        )
    elif not urls:
        typer.echo("None of your tensionlab processes holds a module; name the modules to stop.")
    for name, each in outcomes.items():
        module = names[name] if names[name] == name else f"{names[name]} ({name})"
        if each.error:
            output.print_error(f"{module}: NOT CONFIRMED: {each.error}")
        elif not json:
            typer.echo(f"{module}: estop" + (f"; {each.holder} had it" if each.holder else ""))
    if not urls or any(each.error for each in outcomes.values()):
        raise typer.Exit(1)
