"""Known limits of simulated modules in another process, measured over real TCP in real time."""

import math
import socket
import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest
from scipy.optimize import brentq

import tensionlab as tl
from tensionlab.hardware.client import diagnostics
from tensionlab.hardware.client.group import connect
from tensionlab.hardware.client.links import load_modules
from tensionlab.hardware.runner.settings import RealClock
from tensionlab.validation import characterisation, measurements, protocol
from tensionlab.validation.characterisation import CharacterisationPlan
from tensionlab.validation.measurements import Recorder
from tensionlab.validation.protocol import read_zero
from tensionlab.validation.sensors import open_sensor
from tensionlab.validation.simulated_hand import HandRequest
from tests.validation.test_characterisation import RIG, X, boundary

# `tensionlab simulate` of modules without friction, whose cables do not swing: theory knows their limits.
SERVE = """
from functools import partial
from tensionlab.cli import main
from tensionlab.validation import simulated_hand
from tests.validation.test_characterisation import CLEAN, RIG
plants = {module.name: CLEAN for module in RIG.modules}
simulated_hand.World = partial(simulated_hand.World, plants=plants)
main()
"""


@pytest.mark.realtime
def test_bandwidth_and_stable_walls_over_tcp_are_those_of_theory_for_the_delay(tmp_path, monkeypatch):
    monkeypatch.setattr(protocol, "ZERO_S", 0.3)
    file = tmp_path / "modules.toml"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    words = ("simulate", RIG.name, "--modules", file, "--sensor", port, "--latency-ms", "10")
    served = subprocess.Popen([sys.executable, "-c", SERVE, *map(str, words)], stdout=subprocess.PIPE, text=True)
    try:
        while served.stdout.readline().strip():  # the modules file, and an empty line
            pass
        group = connect(tl.load_rig(RIG.name), load_modules(file))
        with closing(group), closing(open_sensor(f"socket://127.0.0.1:{port}")) as sensor:
            clock = RealClock(group.clients)
            trips = [trip for client in group.clients for trip in diagnostics.measure(client, 20, bool)]
            delay = float(np.nanmedian(trips))

            def measured(grip, measuring, rate=50.0):
                sensor.send(HandRequest(grip, RIG.home).line().encode())
                recorder = Recorder(sensor, read_zero(group, clock, sensor), np.eye(3), delay / 2.0)
                plan = CharacterisationPlan(RIG, rate)
                found = characterisation.run_measurement(plan, group, clock, recorder, measuring(recorder))
                return found, recorder

            rate, frequencies = 20.0, 20.0 * characterisation.RATE_SHARES[-4:]
            response, recorder = measured(
                "hold", lambda r: measurements.force_response(r, X, 0.3, frequencies, rate), rate
            )
            limit = boundary(0.0, delay, float(recorder.state.ages.mean()))

            def walls(r):  # a busy machine is later than its pings
                softer = yield from measurements.wall_trial(r, RIG, X, (0.85 * limit, 0.0), 1.5)
                stiffer = yield from measurements.wall_trial(r, RIG, X, (1.1 * limit, 0.0), 1.5)
                return softer, stiffer

            (softer, stiffer), _ = measured("loose", walls)
    finally:
        served.terminate()
        served.communicate()
    assert 0.02 < delay < 0.03
    held = brentq(lambda frequency: np.sinc(frequency / rate) - math.sqrt(0.5), 0.3 * rate, 0.5 * rate)
    assert response.bandwidth == pytest.approx(held, rel=0.1)
    assert (softer.stable, stiffer.stable) == (True, False)
    assert max(softer.added_damping, stiffer.added_damping) < 0.0  # a late spring alone is never passive
