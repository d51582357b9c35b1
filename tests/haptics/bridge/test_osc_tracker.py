import time

import numpy as np
import pytest

from tensionlab.errors import HardwareError
from tensionlab.haptics.bridge.client_state import Mailbox
from tensionlab.haptics.bridge.osc import OscDoor
from tensionlab.haptics.bridge.osc_tracker import OscTracker
from tensionlab.scenarios import load_scenario

# A rig with the torso as a body.
RIG = load_scenario("collision").rig
HAND, HIP = np.array([0.1, 0.2, 0.3]), np.array([-0.5, 0.0, 1.0])


def test_all_bodies_of_a_bundle_come_as_one_frame_of_the_time_that_its_tag_tells():
    box = Mailbox(RIG)
    with OscDoor(box, "127.0.0.1", 0, print) as door, OscTracker("127.0.0.1", door.port) as tracker:
        for number in range(2):  # 20 ms apart, by the tags
            tracker.send({"hand": HAND * number, "torso": HIP * number}, 1.7e9 + 0.02 * number)
        end = time.monotonic() + 10.0
        while (hip := box.motion("torso", time.monotonic())) is None or not hip.position.any():
            assert time.monotonic() < end
        before, latest = box._frames
    assert latest.frame.time - before.frame.time == pytest.approx(0.02, abs=1e-6)
    assert set(latest.frame.bodies) == {"hand", "torso"}
    for frame, share in ((before, 0.0), (latest, 1.0)):
        np.testing.assert_allclose(frame.frame.bodies["hand"].position, share * HAND, atol=1e-7)
        np.testing.assert_allclose(frame.frame.bodies["torso"].position, share * HIP, atol=1e-7)


def test_nobody_needs_to_listen():
    with OscTracker("127.0.0.1", 9) as tracker:
        for _ in range(3):
            tracker.send({"hand": HAND}, time.time())


def test_a_host_that_does_not_exist_is_refused():
    with pytest.raises(HardwareError, match=r"OSC cannot be sent to nowhere\.invalid, port 9000"):
        OscTracker("nowhere.invalid", 9000)
