"""A floor to push on, for ten seconds: ``python examples/bridge/client.py ws://127.0.0.1:8765``."""

import math
import sys
import time

from tensionlab.haptics.bridge.client import BridgeClient

FLOOR = {
    "floor": {"kind": "wall", "plane": {"point": [0.0, 0.3, 0.0], "normal": [0.0, 1.0, 0.0]}, "stiffness": 100.0}
}


def main() -> None:
    """Move a hand up and down through the floor, 90 times a second."""
    url = sys.argv[1] if len(sys.argv) > 1 else "ws://127.0.0.1:8765"
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    with BridgeClient(url) as bridge:
        print(f"{bridge.welcome.rig}: {', '.join(bridge.welcome.modules)}")
        start = time.monotonic()
        while (now := time.monotonic() - start) < seconds:
            hand = (0.0, 0.3 + 0.02 * math.cos(2.0 * now), 0.0)
            state = bridge.frame(now, hand, FLOOR)
            time.sleep(1.0 / 90.0)
        print(f"desired {state.desired} N, measured {state.measured} N")


if __name__ == "__main__":
    main()
