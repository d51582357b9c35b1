"""The simulated module: what it is told, and what it refuses."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tensionlab.errors import InputError
from tensionlab.hardware.simulation.simulated_module import STEP_S, HangingMass, SimulatedModule


def test_a_trace_has_a_row_for_each_step_and_ends_at_the_sample():
    module = SimulatedModule(distance=0.8)
    trace = module.trace(0.01, 0.81)
    assert len(trace.seconds) == round(0.01 / STEP_S) == 40
    np.testing.assert_allclose(np.diff(trace.seconds), STEP_S)
    np.testing.assert_allclose(np.diff(trace.distance), 0.01 / 40)
    last = module.sample
    for name in ("seconds", "distance", "length", "tension", "commanded", "current", "state", "driver_on"):
        assert getattr(trace, name)[-1] == getattr(last, name), name


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SimulatedModule(plant={"mass": 1.0}), "no parameter 'mass'; it has resistance, "),
        (lambda: SimulatedModule(plant={"inertia": 0.0}), "'inertia' is finite and at least 1e-07 kg m2; got 0.0"),
        (lambda: SimulatedModule(plant={"inertia": np.nan}), "got nan"),
        (lambda: SimulatedModule(distance=0.0), "finite distance of more than 0 m; got 0.0"),
        (lambda: HangingMass(0.1).advance(0.1, 0.5), "moves the cable's far end by itself"),
        (lambda: SimulatedModule().advance(-1.0), "time passes by 0 to 1e6 s; got -1.0"),
        (lambda: SimulatedModule().advance(np.nan), "got nan"),
        (lambda: SimulatedModule().trace(0.1, np.inf), "distance"),
        (lambda: SimulatedModule().damage("wheel"), "no part 'wheel'; it has encoder, "),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_another_thread_sees_a_module_only_between_steps():
    def numbers(sample):
        return sample.seconds, sample.length, sample.tension

    start, trace = SimulatedModule().sample, SimulatedModule().trace(60.0, 1.3)
    states = {numbers(start), *zip(*numbers(trace), strict=True)}
    module = SimulatedModule()
    seen = set()
    with ThreadPoolExecutor(1) as other:
        running = other.submit(module.advance, 60.0, 1.3)
        while not running.done():
            seen.add(numbers(module.sample))
    assert seen <= states
