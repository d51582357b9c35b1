"""All parts of a module in their places."""

from __future__ import annotations

from build123d.topology import Part

from kit import bought, parameters
from kit.bracket import bracket
from kit.brake import pawl, ratchet
from kit.guide import cable_guide
from kit.housing import cover, tub
from kit.link import breakaway_link
from kit.magnet import magnet_mount
from kit.spool import spool


def printed() -> dict[str, Part]:
    """Return the printed parts by their names, the pawl laid on."""
    return {
        "spool": spool(),
        "ratchet": ratchet(),
        "pawl": pawl(),
        "bracket": bracket(),
        "magnet-mount": magnet_mount(),
        "cable-guide": cable_guide(),
        "tub": tub(),
        "cover": cover(),
        "breakaway-link": breakaway_link(),
    }


def purchased(lifted: bool = False) -> dict[str, Part]:
    """Return the bought parts, with the servo's horn as it lifts the pawl or lets it down."""
    return {
        "motor": bought.motor(),
        "encoder": bought.encoder(),
        "magnet": bought.magnet(),
        "pin": bought.pin(),
        "cable": bought.cable(),
        "servo": bought.servo(),
        "horn": bought.horn(parameters.horn_lifts if lifted else parameters.horn_free),
    }


def assembled(lifted: bool = False) -> dict[str, Part]:
    """Return all parts that are in their places: the link is at the cable's end, and not here."""
    parts = printed() | purchased(lifted)
    del parts["breakaway-link"]
    if lifted:
        parts["pawl"] = pawl(parameters.pawl_lift)
    return parts
