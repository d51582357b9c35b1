"""``tensionlab module doctor``: what is miswired, miscalibrated or missing on one module."""

from __future__ import annotations

from typing import Annotated

import typer

from tensionlab.cli.common import output
from tensionlab.cli.common.links import exit_if_failed, find_links
from tensionlab.cli.common.verbs import Json, flag
from tensionlab.errors import HardwareError
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.diagnosis import LEFT_OUT, Check, diagnose
from tensionlab.support.formatting import format_count


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
