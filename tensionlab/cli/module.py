"""``tensionlab module``: find modules, see how they are, and stop them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensionlab.cli.calibrate import calibrate
from tensionlab.cli.common import output
from tensionlab.cli.common.module_targets import Json, ModulesFile, Words, complain, on_all, targets
from tensionlab.cli.module_config import config
from tensionlab.cli.module_monitor import monitor
from tensionlab.cli.module_ping import ping

if TYPE_CHECKING:
    from tensionlab.hardware.client.module import ModuleClient
    from tensionlab.hardware.protocol.codes import State
    from tensionlab.hardware.protocol.messages import Info, Message

module = typer.Typer(
    help="Find modules, see how they are, set them up and stop them.", no_args_is_help=True, rich_markup_mode=None
)


@module.command()
def discover(
    words: Words = None,
    modules: ModulesFile = None,
    everything: Annotated[bool, typer.Option("--all", help="Ask every serial port.")] = False,
    json: Json = False,
) -> None:
    """Find the modules at this computer's ports: USB, and Bluetooth where they are paired.

    Only ports that look like a module's are asked, unless told otherwise; those in use are only listed. With
    links, those are asked. Exit status 1 if no module was found.
    """
    from tensionlab.hardware.client.discovery import ask_all, ports

    urls = ports(everything=everything) if not words and modules is None else None
    if urls is None:
        urls = {url: name if name != url else "" for name, url in targets(words, modules).items()}
    found = ask_all(urls)
    if json:
        output.print_json(
            [
                {
                    "url": each.url,
                    "port": each.about,
                    "in_use": each.in_use,
                    "problem": each.problem or None,
                    "info": each.info and _plain(each.info),
                }
                for each in found
            ]
        )
    elif not found:
        output.console().print("no port looks like a module's; --all asks every serial port")
    else:
        grid = output.table()
        for heading in ("link", "port", "serial\nnumber", "firm-\nware", "state"):
            grid.add_column(heading, overflow="fold")
        for each in found:
            if each.info is None:
                grid.add_row(each.url, each.about, "", "", each.problem)
            else:
                state = each.info.state.name.lower() + ("" if each.info.calibrated else ", not calibrated")
                grid.add_row(each.url, each.about, _serial(each.info), _firmware(each.info), state)
        output.console().print(grid)
    if not any(each.info or each.in_use for each in found):
        raise typer.Exit(1)


@module.command()
def info(words: Words = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Show what modules say of themselves: versions, state, limits, calibration."""
    from tensionlab.hardware.client.module import ModuleClient

    links = targets(words, modules)
    answers, failed = on_all(links, ModuleClient.hello)
    if json:
        output.print_json(
            [
                {"module": name, "url": url, "info": _plain(answers[name]) if name in answers else None}
                | ({"error": str(failed[name])} if name in failed else {})
                for name, url in links.items()
            ]
        )
    elif answers:
        grid = output.table(gap=1)
        grid.add_column("module", overflow="fold")
        for heading in ("serial\nnumber", "firm-\nware", "state", "cali-\nbrated", "length\nknown", "started\nby"):
            grid.add_column(heading)
        for heading in ("TTL\nms", "tension\nN", "gain\nN/A", "spool\nmm"):
            grid.add_column(heading, justify="right", no_wrap=True)
        for name, each in answers.items():
            grid.add_row(
                name,
                _serial(each),
                _firmware(each),
                each.state.name.lower(),
                "yes" if each.calibrated else "no",
                "yes" if each.length_known else "no",
                each.reset_reason.name.lower(),
                str(each.ttl_ms),
                f"{each.tension_lower:g} to {each.tension_upper:g}",
                f"{each.newton_per_ampere:.3g}",
                f"{1e3 * each.spool_radius:.3g}",
            )
        output.console().print(grid)
    complain(failed)


@module.command()
def identify(words: Words = None, modules: ModulesFile = None) -> None:
    """Pulse the cable of each module three times, gently, one module after another.

    It is armed for that, with its taut minimum and half a newton more, and stopped at the end. A module that
    somebody has armed is left alone.
    """
    from tensionlab.hardware.client.identify import identify as pulse

    def job(client: ModuleClient) -> None:
        url = "" if client.name == client.link.url else f" ({client.link.url})"
        pulse(client, lambda: typer.echo(f"{client.name}{url}: its cable pulses now"))

    failed = {}
    for name, url in targets(words, modules).items():
        failed.update(on_all({name: url}, job)[1])
    complain(failed)


@module.command()
def stop(words: Words = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Have modules let go and be idle. Exit status 1 if one did not confirm it."""
    from tensionlab.hardware.protocol.messages import Stop

    _tell(targets(words, modules), Stop(), json)


@module.command()
def estop(words: Words = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Have modules let go at once, and stay so until cleared. Exit status 1 if one did not confirm it.

    `tensionlab estop` reaches those that another process uses as well.
    """
    from tensionlab.hardware.protocol.messages import EmergencyStop

    _tell(targets(words, modules), EmergencyStop(), json)


@module.command()
def clear(words: Words = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Have modules leave fault or emergency stop. Refused while what caused a fault is still there."""
    from tensionlab.hardware.protocol.messages import Clear

    _tell(targets(words, modules), Clear(), json)


def _tell(links: Mapping[str, str], command: Message, json: bool) -> None:
    """Have all carry out a command, and show in which state that left them."""
    from tensionlab.errors import ModuleFault
    from tensionlab.hardware.client.group import PATIENT_TIMEOUTS_S
    from tensionlab.hardware.protocol.codes import LATCHED_STATES
    from tensionlab.hardware.protocol.messages import Stop

    def tell(client: ModuleClient) -> State | None:
        try:
            client.command(command, PATIENT_TIMEOUTS_S)
        except ModuleFault:  # its driver is off already
            if not (isinstance(command, Stop) and client.state in LATCHED_STATES):
                raise
        return client.state

    states, failed = on_all(links, tell)
    if json:
        output.print_json(
            [
                {
                    "module": name,
                    "url": url,
                    "confirmed": name in states,
                    "state": getattr(states.get(name), "name", None),
                    "error": str(failed[name]) if name in failed else None,
                }
                for name, url in links.items()
            ]
        )
    else:
        for name, state in states.items():
            off = ": driver off; `tensionlab module clear` leads out of it" if state in LATCHED_STATES else ""
            typer.echo(f"{name}: {'done' if state is None else state.name.lower()}{off}")
    complain(failed)


def _plain(info: Info) -> dict[str, Any]:
    """As JSON: codes by their names."""
    names = {"state": info.state.name, "reset_reason": info.reset_reason.name, "firmware": _firmware(info)}
    return {**asdict(info), **names}


def _serial(info: Info) -> str:
    """As in the module's Bluetooth name."""
    return f"{info.serial_number:08x}"


def _firmware(info: Info) -> str:
    from tensionlab.hardware.client.parameter_file import firmware

    return firmware(info)


module.command()(ping)
module.command()(monitor)
module.add_typer(config, name="config")
module.add_typer(calibrate, name="calibrate")
