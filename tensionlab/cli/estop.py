"""``tensionlab estop``: all modules let go, now."""

from __future__ import annotations

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.module_targets import Json, ModulesFile, Words, targets
from tensionlab.cli.ending import say


def estop(words: Words = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Have modules let go at once, and stay so until cleared: those that another process uses, too.

    Without links and file: all modules that processes of yours use on this computer. Such a process is told to
    stop its modules, and has some seconds to let go of them; then each module is asked to confirm. Exit status 1
    if one did not confirm. `tensionlab module clear` leads out of it.

    This is software. Whatever it says, the cut of the motor supply is what protects.
    """
    from tensionlab.hardware.client.emergency_stop import emergency_stop
    from tensionlab.hardware.client.locks import locked_links

    links = {url: url for url in locked_links()} if not words and modules is None else targets(words, modules)
    outcomes = emergency_stop(links) if links else {}
    if json:
        output.print_json(
            [
                {
                    "module": name,
                    "url": links[name],
                    "confirmed": not each.error,
                    "process": each.holder and each.holder.pid,
                    "error": each.error or None,
                }
                for name, each in outcomes.items()
            ]
        )
    elif not links:
        typer.echo("no process of yours uses a module; name the modules that are to stop")
    for name, each in outcomes.items():
        if each.error:
            say(f"{name}: NOT CONFIRMED: {each.error}")
        elif not json:
            typer.echo(f"{name}: estop" + (f"; {each.holder} had it" if each.holder else ""))
    if not links or any(each.error for each in outcomes.values()):
        raise typer.Exit(1)
