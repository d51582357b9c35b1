"""A floor and a weight over OSC, for ten seconds: ``python examples/bridge/osc_client.py 9001``.

Start the bridge with ``tensionlab serve bartels2026-validation --osc 9001``. OSC has no answers: the state page of
the bridge shows the force, and what is refused is a line of the terminal that it runs in.
"""

import math
import sys
import time

from pythonosc.udp_client import SimpleUDPClient

HEIGHT_M, DEPTH_M = 0.31, 0.02


def main() -> None:
    """Place a floor and a weight, and move a hand up and down through the floor, 90 times a second."""
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 9001
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    with SimpleUDPClient("127.0.0.1", port) as bridge:
        place = ["plane.point", 0.0, HEIGHT_M, 0.0, "plane.normal", 0.0, 1.0, 0.0]
        bridge.send_message("/effect/floor", ["wall", *place, "stiffness", 100.0])
        bridge.send_message("/effect/box", ["weight", "mass", 0.05])
        start = time.monotonic()
        while (now := time.monotonic() - start) < seconds:
            bridge.send_message("/body/hand", [0.0, HEIGHT_M - DEPTH_M * math.sin(2.0 * now), 0.0])
            time.sleep(1.0 / 90.0)
        bridge.send_message("/effect/box", [])  # alone: it ends


if __name__ == "__main__":
    main()
