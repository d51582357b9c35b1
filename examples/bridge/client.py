"""A floor to push on, for ten seconds: ``python examples/bridge/client.py ws://127.0.0.1:8765``."""

import math
import sys
import time
from collections.abc import Sequence

from tensionlab.haptics.bridge.client import BridgeClient

DEPTH_M, STIFFNESS_N_PER_M = 0.02, 100.0


def main() -> None:
    """Move a hand up and down through a floor, 90 times a second, and print the force that it felt."""
    url = sys.argv[1] if len(sys.argv) > 1 else "ws://127.0.0.1:8765"
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    with BridgeClient(url) as bridge:
        welcome = bridge.welcome
        print(f"{welcome.rig}: {', '.join(welcome.modules)}")
        home = bridge.frame(0.0).position
        axis = (welcome.up or "y").replace("-", "")
        up = [float(each == axis) for each in "xyz"[: len(home)]]
        floor = {"kind": "wall", "plane": {"point": home, "normal": up}, "stiffness": STIFFNESS_N_PER_M}
        largest, start = bridge.frame(0.0, tuple(home), {"floor": floor}), time.monotonic()
        while (now := time.monotonic() - start) < seconds:
            height = DEPTH_M * math.cos(2.0 * now)
            hand = tuple(at + height * along for at, along in zip(home, up, strict=True))
            state = bridge.frame(now, hand)
            largest = max(largest, state, key=lambda each: size(each.measured))
            time.sleep(1.0 / 90.0)
    desired, measured = (size(force) for force in (largest.desired, largest.measured))
    print(f"largest measured force {measured:.2f} N, where {desired:.2f} N was desired")


def size(force: Sequence[float | None]) -> float:
    """Return the size of a force in N, 0 where it is not known."""
    return math.hypot(*(part or 0.0 for part in force))


if __name__ == "__main__":
    main()
