"""Datagrams of a tracker that speaks OSC."""

from pythonosc.osc_bundle_builder import OscBundleBuilder
from pythonosc.osc_message_builder import build_msg


def bundle_of(bodies, when):
    """Return the datagram with positions of bodies, by name, in m, at a time in s since 1970."""
    bundle = OscBundleBuilder(when)
    for name, position in bodies.items():
        bundle.add_content(build_msg(f"/body/{name}", position.tolist()))
    return bundle.build().dgram
