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
    else:
        urls = {url: url for url in sorted(locked_links())}
    outcomes = emergency_stop(urls) if urls else {}
    # A URL is called as the process that has it calls its module.
    names = {
        name: (name == urls[name] and outcome.holder and outcome.holder.module) or name
        for name, outcome in outcomes.items()
    }
    if json:
        output.print_json(
            [
                {
                    "module": names[name],
                    "url": urls[name],
                    "confirmed": not outcome.error,
                    "process": outcome.holder and outcome.holder.pid,
                    "error": outcome.error or None,
                }
                for name, outcome in outcomes.items()
            ]
        )
    elif not urls:
        typer.echo("None of your tensionlab processes holds a module; name the modules to stop.")
    for name, outcome in outcomes.items():
        if outcome.error:
            output.print_error(f"{names[name]}: NOT CONFIRMED: {outcome.error}")
        elif not json:
            typer.echo(f"{names[name]}: estop" + (f"; {outcome.holder} had it" if outcome.holder else ""))
    if not urls or any(outcome.error for outcome in outcomes.values()):
        raise typer.Exit(1)
