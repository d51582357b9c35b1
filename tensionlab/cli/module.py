"""``tensionlab module`` and ``tensionlab estop``: find modules, show how they are, and stop them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tensionlab.cli.common import options, output
from tensionlab.cli.common.modules import call_all, exit_if_failed, find_links, json_rows
from tensionlab.cli.common.options import Json, Links, ModulesFile
from tensionlab.cli.module_calibrate import calibrate
from tensionlab.cli.module_config import config
from tensionlab.cli.module_monitor import monitor, ping

if TYPE_CHECKING:
    from tensionlab.hardware.client.module import ModuleClient
    from tensionlab.hardware.protocol.codes import State
    from tensionlab.hardware.protocol.messages import Info, Message

module = options.group("Find modules, show how they are, set them up and stop them.")
INFO = ("<module", "<serial\nnumber", "<firm-\nware", "<state", "<cali-\nbrated", "<length\nknown", "<started\nby",
        "TTL\nms", "tension\nN", "gain\nN/A", "spool\nmm")  # fmt: skip
"""Columns of `info`."""


@module.command()
def discover(
    links: Links = None,
    modules: ModulesFile = None,
    everything: Annotated[bool, typer.Option("--all", help="Try every serial port.")] = False,
    json: Json = False,
) -> None:
    """Find the modules at this computer's ports.

    USB, and Bluetooth where they are paired. Only ports that look like a module's are tried, unless --all is
    given; ports in use are only listed. With links, those are tried instead. Exit status 1 if no module was
    found.
    """
    from tensionlab.hardware.client.discovery import find_all, ports
    from tensionlab.hardware.client.parameter_file import firmware

    urls = ports(everything=everything) if not links and modules is None else None
    if urls is None:
        urls = {url: name if name != url else "" for name, url in find_links(links, modules).items()}
    found = find_all(urls)
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
        output.console().print("no port looks like a module's; --all tries every serial port")
    else:
        rows = []
        for each in found:
            if each.info is None:
                rows.append((each.url, each.about, "", "", each.problem))
            else:
                state = each.info.state.name.lower() + ("" if each.info.calibrated else ", not calibrated")
                rows.append((each.url, each.about, f"{each.info.serial_number:08x}", firmware(each.info), state))
        output.print_table("", ("<link", "<port", "<serial\nnumber", "<firm-\nware", "<state"), rows)
    if not any(each.info or each.in_use for each in found):
        raise typer.Exit(1)


@module.command()
def info(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Show versions, state, limits and calibration of modules."""
    from tensionlab.hardware.client.module import ModuleClient
    from tensionlab.hardware.client.parameter_file import firmware

    urls = find_links(links, modules)
    answers, failed = call_all(urls, ModuleClient.hello)
    if json:
        found = {name: _plain(each) for name, each in answers.items()}
        output.print_json(json_rows(urls, failed, lambda name: {"info": found.get(name)}))
    elif answers:
        rows = (
            (
                name,
                f"{each.serial_number:08x}",
                firmware(each),
                each.state.name.lower(),
                each.calibrated,
                each.length_known,
                each.reset_reason.name.lower(),
                each.ttl_ms,
                f"{each.tension_lower:g} to {each.tension_upper:g}",
                f"{each.newton_per_ampere:.3g}",
                f"{1e3 * each.spool_radius:.3g}",
            )
            for name, each in answers.items()
        )
        output.print_table("", INFO, rows, gap=1)
    exit_if_failed(failed)


@module.command()
def identify(links: Links = None, modules: ModulesFile = None) -> None:
    """Pulse the cables of modules, one after another.

    Three times, and gently. Each module is armed for that, with its lower tension limit and half a newton more,
    and stopped at the end. A module that is armed already is left alone.
    """
    from tensionlab.hardware.client.discovery import identify as pulse

    def job(client: ModuleClient) -> None:
        url = "" if client.name == client.link.url else f" ({client.link.url})"
        pulse(client, lambda: typer.echo(f"{client.name}{url}: its cable pulses now"))

    failed = {}
    for name, url in find_links(links, modules).items():
        failed.update(call_all({name: url}, job)[1])
    exit_if_failed(failed)


@module.command()
def stop(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Stop modules: they release their cables and are idle. Exit status 1 if one did not confirm it."""
    from tensionlab.hardware.protocol.messages import Stop

    _command(find_links(links, modules), Stop(), json)


@module.command()
def estop(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Stop modules at once, until they are cleared. Exit status 1 if one did not confirm it.

    `tensionlab estop` also reaches modules that another process uses.
    """
    from tensionlab.hardware.protocol.messages import EmergencyStop

    _command(find_links(links, modules), EmergencyStop(), json)


@module.command()
def clear(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Have modules leave fault or emergency stop. Refused while what caused a fault is still there."""
    from tensionlab.hardware.protocol.messages import Clear

    _command(find_links(links, modules), Clear(), json)


def _command(urls: Mapping[str, str], command: Message, json: bool) -> None:
    """Send all modules a command, and print in which state that left them."""
    from tensionlab.errors import ModuleFault
    from tensionlab.hardware.client.group import PATIENT_TIMEOUTS_S
    from tensionlab.hardware.protocol.codes import LATCHED_STATES
    from tensionlab.hardware.protocol.messages import Stop

    def send(client: ModuleClient) -> State | None:
        try:
            client.command(command, PATIENT_TIMEOUTS_S)
        except ModuleFault:  # its driver is off already
            if not (isinstance(command, Stop) and client.state in LATCHED_STATES):
                raise
        return client.state

    states, failed = call_all(urls, send)
    if json:
        names = {name: None if state is None else state.name for name, state in states.items()}
        output.print_json(
            json_rows(urls, failed, lambda name: {"confirmed": name in names, "state": names.get(name)})
        )
    else:
        for name, state in states.items():
            off = ": driver off; `tensionlab module clear` leads out of it" if state in LATCHED_STATES else ""
            typer.echo(f"{name}: {'done' if state is None else state.name.lower()}{off}")
    exit_if_failed(failed)


def estop_all(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Stop modules at once, also those of other processes.

    They stay stopped until they are cleared. Without links and file: all modules that processes of yours use on
    this computer. Each such process gets some seconds to stop and release its modules; then each module has to
    confirm. Exit status 1 if one did not. `tensionlab module clear` leads out of it.

    This is software. Whatever it says, only cutting the motors' supply protects.
    """
    from tensionlab.hardware.client.emergency_stop import emergency_stop
    from tensionlab.hardware.client.locks import locked_links

    urls = {url: url for url in locked_links()} if not links and modules is None else find_links(links, modules)
    outcomes = emergency_stop(urls) if urls else {}
    if json:
        output.print_json(
            [
                {
                    "module": name,
                    "url": urls[name],
                    "confirmed": not each.error,
                    "process": each.holder and each.holder.pid,
                    "error": each.error or None,
                }
                for name, each in outcomes.items()
            ]
        )
    elif not urls:
        typer.echo("no process of yours uses a module; name the modules that are to stop")
    for name, each in outcomes.items():
        if each.error:
            output.print_error(f"{name}: NOT CONFIRMED: {each.error}")
        elif not json:
            typer.echo(f"{name}: estop" + (f"; {each.holder} had it" if each.holder else ""))
    if not urls or any(each.error for each in outcomes.values()):
        raise typer.Exit(1)


def _plain(info: Info) -> dict[str, Any]:
    """Return what a module reports of itself as JSON has it: codes by their names."""
    from tensionlab.hardware.client.parameter_file import firmware

    names = {"state": info.state.name, "reset_reason": info.reset_reason.name, "firmware": firmware(info)}
    return {**asdict(info), **names}


module.command()(ping)
module.command()(monitor)
module.add_typer(config, name="config")
module.add_typer(calibrate, name="calibrate")
