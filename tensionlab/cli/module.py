"""``tensionlab module``: find, show, set up and stop modules."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.links import Links, ModulesFile, call_all, exit_if_failed, find_links, print_all
from tensionlab.cli.common.verbs import Json, Verbs, flag
from tensionlab.cli.module_calibrate import calibrate
from tensionlab.cli.module_monitor import monitor, ping
from tensionlab.errors import HardwareError, ModuleFault
from tensionlab.hardware.client import parameter_file
from tensionlab.hardware.client.diagnostics import find_all, ports
from tensionlab.hardware.client.diagnostics import identify as pulse
from tensionlab.hardware.client.module import PATIENT_TIMEOUTS_S, ModuleClient
from tensionlab.hardware.client.parameter_file import Change, firmware, plain
from tensionlab.hardware.diagnosis import LEFT_OUT, Check, diagnose
from tensionlab.hardware.protocol import messages
from tensionlab.hardware.protocol.codes import LATCHED_STATES, PARAMETERS, State
from tensionlab.hardware.protocol.messages import Clear, Info, Message, ParameterValue, Stop
from tensionlab.support.files.reading import read_text
from tensionlab.support.formatting import format_count
from tensionlab.support.table import Column, Table

module = Verbs("Find, inspect, set up and stop modules.")
config = Verbs("Get and set the parameters of modules. The modules must be idle.")
LinksAndParameters = Annotated[
    list[str] | None,
    typer.Argument(metavar="URL|PARAMETER", help="Links to modules, or names with --modules; and parameters."),
]
Save = Annotated[bool, flag("--save", "Store all parameters: they outlast the next start.")]
# Columns of `info`.
INFO = ("module", "serial number", "firm- ware", "state", "cali- brated", "length known", "started by",
        Column("TTL", "ms"), Column("tension", "N"), Column("gain", "N/A", ".3g"),
        Column("spool", "mm", ".3g"))  # fmt: skip


@module.command()
def discover(
    everything: Annotated[bool, flag("--all", "Try all serial ports.")] = False, json: Json = False
) -> None:
    """Find the modules at this computer's ports.

    USB, and Bluetooth where they are paired. Only ports that look like a module's are tried, unless --all is
    given; ports in use are only listed. Exit status 1 if no module was found.
    """
    candidates = find_all(ports(everything=everything))
    if json:
        output.print_json(
            [
                {"url": port.url, "port": port.about, "in_use": port.in_use, "problem": port.problem or None,
                 "info": _info_json(port.info)}
                for port in candidates
            ]
        )  # fmt: skip
    elif not candidates:
        output.print_line("no port looks like a module's; --all tries every serial port")
    else:
        rows = []
        for port in candidates:
            known = ("", "", port.problem)
            if port.info is not None:
                state = port.info.state.name.lower() + ("" if port.info.calibrated else ", not calibrated")
                known = (f"{port.info.serial_number:08x}", firmware(port.info), state)
            rows.append((port.url, port.about, *known))
        output.print_table(Table(["link", "port", "serial number", "firm- ware", "state"], rows))
    if not any(port.info or port.in_use for port in candidates):
        raise typer.Exit(1)


def _info_json(info: Info | None) -> dict[str, Any] | None:
    return None if info is None else {**asdict(info), "firmware": firmware(info)}


@module.command()
def info(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Show versions, state, limits and calibration of modules."""

    def show(answers: dict[str, Info]) -> None:
        rows = [
            (name, f"{answer.serial_number:08x}", firmware(answer), answer.state.name.lower(), answer.calibrated,
             answer.length_known, answer.reset_reason.name.lower(), answer.ttl_ms,
             f"{answer.tension_lower:g} to {answer.tension_upper:g}", answer.newton_per_ampere,
             1e3 * answer.spool_radius)
            for name, answer in answers.items()
        ]  # fmt: skip
        output.print_table(Table(INFO, rows))

    print_all(find_links(links, modules), ModuleClient.hello, json, lambda each: {"info": _info_json(each)}, show)


@module.command()
def identify(links: Links = None, modules: ModulesFile = None) -> None:
    """Pulse the cables of modules, one after another.

    Three times, and gently. Each module is armed for that, with its lower tension limit and half a newton more,
    and stopped at the end. A module that is armed already is left alone.
    """

    def job(client: ModuleClient) -> None:
        url = "" if client.name == client.link.url else f" ({client.link.url})"
        pulse(client, lambda: typer.echo(f"{client.name}{url}: its cable pulses now"))

    failed = {}
    for name, url in find_links(links, modules).items():
        failed.update(call_all({name: url}, job)[1])
    exit_if_failed(failed)


@module.command()
@output.if_interrupted("the module is stopped")
def doctor(
    url: Annotated[str, typer.Argument(metavar="URL", help="Link to the module.")],
    still: Annotated[bool, flag("--no-motion", "Only read; nothing moves.")] = False,
    yes: Annotated[bool, flag("--yes", "Do not ask before motion; no hand pulls the cable.")] = False,
    json: Json = False,
) -> None:
    """Find what is miswired, miscalibrated or missing on a module.

    Reads its state, parameters and sensors. If those are right, it asks for a pull by hand, turns the spool to and
    fro by less than 2 cm of cable to check the motor, its wires and the current sensing, and at last pulls gently:
    fix the cable's end, with 3 cm of slack. It never arms a module that is not calibrated, has a fault, is used by
    another program, or may hold a load (`brake_on_fault`). It changes nothing. Exit status 1 if a fault is found.
    """
    find_links([url], None)
    checks: list[Check] = []
    failed: dict[str, HardwareError] = {}
    try:
        with ModuleClient(url, url) as client:
            for check in diagnose(client, move=not still, ask=None if yes else output.wait_for_enter):
                checks.append(check)
                if json:
                    continue
                mark = "✗" if check.finding else ("–" if check.result.startswith(LEFT_OUT) else "✓")
                meaning = f"\n  {check.meaning}" if check.finding else ""
                output.print_line(f"{mark} {check.name:<9}{check.result}{meaning}")
    except HardwareError as error:
        failed[url] = error
    faults = sum(bool(check.finding) for check in checks)
    if json:
        why = str(failed[url]) if failed else None
        output.print_json(url=url, healthy=not faults and not failed, checks=checks, error=why)
    elif not failed:
        output.print_line(f"{format_count(faults, 'fault')} found; bring-up: firmware/README.md")
    exit_if_failed(failed)
    if faults:
        raise typer.Exit(1)


@module.command()
def stop(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Stop modules: they release their cables and are idle. Exit status 1 if one did not confirm it."""
    _command(find_links(links, modules), Stop(), json)


@module.command()
def clear(links: Links = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Clear a fault or an emergency stop. Refused while the cause of a fault is still there."""
    _command(find_links(links, modules), Clear(), json)


def _command(urls: Mapping[str, str], command: Message, json: bool) -> None:
    """Send all modules a command, and print in which state that left them."""

    def send(client: ModuleClient) -> dict[str, State | None]:
        try:
            client.command(command, PATIENT_TIMEOUTS_S)
        except ModuleFault:  # its driver is off already
            if not (isinstance(command, Stop) and client.state in LATCHED_STATES):
                raise
        return {"state": client.state}

    def show(answers: dict[str, dict[str, State | None]]) -> None:
        for name, answer in answers.items():
            state = answer["state"]
            off = ": driver off; `tensionlab module clear` leads out of it" if state in LATCHED_STATES else ""
            typer.echo(f"{name}: {'done' if state is None else state.name.lower()}{off}")

    print_all(urls, send, json, lambda each: {"confirmed": each is not None, **(each or {"state": None})}, show)


@config.command()
def get(words: LinksAndParameters = None, modules: ModulesFile = None, json: Json = False) -> None:
    """Show parameters, such as slew or ttl; all of them if none is named."""
    named, others = _split(words, PARAMETERS.__contains__)
    named = named or list(PARAMETERS)

    def to_json(found: dict[str, ParameterValue] | None) -> dict[str, Any]:
        return {"parameters": found and {name: found[name].value for name in named}}

    def show(answers: dict[str, dict[str, ParameterValue]]) -> None:
        rows = [
            [name, *(answer[name].value for answer in answers.values()), PARAMETERS[name].unit,
             PARAMETERS[name].meaning if len(answers) == 1 else ""]
            for name in named
        ]  # fmt: skip
        columns = ["parameter", *(Column(module, format=plain) for module in answers), "unit", "meaning"]
        output.print_table(Table(columns, rows))

    print_all(find_links(others, modules), parameter_file.parameters, json, to_json, show)


@config.command(name="set")
def set_(words: LinksAndParameters = None, modules: ModulesFile = None, save: Save = False) -> None:
    """Change parameters, such as slew=50 ttl=200, until the next start, or for good with --save."""
    settings, others = _split(words, lambda word: "=" in word)
    if not settings:
        raise typer.BadParameter("no parameters; write them like slew=50")
    values: dict[str, float] = {}
    for name, _, value in (word.partition("=") for word in settings):
        try:
            values[name] = float(value)
        except ValueError:
            raise typer.BadParameter(f"{name}={value}: give a number, such as {name}=50") from None
    parameter_file.checked(values, "set")
    _change(find_links(others, modules), values, "set", save)


def _split(words: list[str] | None, is_parameter: Callable[[str], bool]) -> tuple[list[str], list[str]]:
    parameters = [word for word in words or () if is_parameter(word)]
    return parameters, [word for word in words or () if word not in parameters]


@config.command()
def dump(links: Links = None, modules: ModulesFile = None) -> None:
    """Print all parameters of a module as a file (TOML)."""
    urls = find_links(links, modules)
    if len(urls) > 1:
        raise typer.BadParameter("more than one module; name one")
    texts, failed = call_all(urls, parameter_file.dump)
    typer.echo("".join(texts.values()), nl=False)
    exit_if_failed(failed)


@config.command()
def restore(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="What dump wrote, or a part of it.")],
    links: Links = None,
    modules: ModulesFile = None,
    save: Save = False,
) -> None:
    """Set the parameters of modules from a file, until the next start, or for good with --save.

    What the file does not name stays as it is. It is taken over as a whole, or not at all.
    """
    text = read_text(path, "a file of parameters (*.toml)", HardwareError)
    _change(find_links(links, modules), parameter_file.parse(text, str(path)), str(path), save)


def _change(links: Mapping[str, str], values: Mapping[str, float], source: str, save: bool) -> None:
    def change_and_save(client: ModuleClient) -> list[Change]:
        changes = parameter_file.change(client, values, source)
        if save:
            client.command(messages.Save())
        return changes

    answers, failed = call_all(links, change_and_save)
    for name, changes in answers.items():
        for change in changes:
            typer.echo(f"{name}: {change.name} {plain(change.before)} -> {plain(change.after)}")
        if not changes:
            typer.echo(f"{name}: nothing to change")
        if save:
            typer.echo(f"{name}: stored")
        if parameter_file.LENGTH_PARAMETERS & {change.name for change in changes}:
            typer.echo(f"{name}: it no longer knows how long its cable is; calibrate that")
    exit_if_failed(failed)


module.command()(ping)
module.command()(monitor)
module.add_typer(config, name="config")
module.add_typer(calibrate, name="calibrate")
