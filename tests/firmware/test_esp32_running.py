"""The whole layer of the ESP32, run here against fakes of its libraries and the simulated motor.

Its time passes only where a test waits, a millisecond at a time.
"""

import os
import select
import struct
import subprocess
import sys

import numpy as np
import pytest

from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, Code, Fault, ResetReason, State
from tensionlab.hardware.protocol.messages import (
    Acknowledge,
    Arm,
    Calibrate,
    ConfigureTelemetry,
    Decoder,
    EmergencyStop,
    Event,
    GetParameter,
    Hello,
    Info,
    Log,
    ParameterValue,
    Save,
    SetParameter,
    SetTension,
    Stop,
    Telemetry,
    read,
)
from tests.helpers.compiled import FIRMWARE, compile_program

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the fakes are for POSIX")
ZERO = 2.0  # rad, electrical, of the fakes' rotor


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    sources = [source for folder in ("core", "esp32", "fakes") for source in FIRMWARE.glob(f"{folder}/*.cpp")]
    # The window for pairing is a minute; here it is 10 s.
    options = ("-std=c++17", "-O1", "-pthread", "-Wall", "-Wextra", "-Werror", "-DTENSIONLAB_PAIRING_S=10")
    return compile_program("esp32_pipes", tmp_path_factory.mktemp("esp32"), *sources, options=options)


class Wire:
    """One end of a link by two pipes."""

    def __init__(self, into, out, advance):
        self.into, self._out, self._advance = into, out, advance
        self._decoder, self._heard, self._sequence = Decoder(), [], 0

    def send(self, message):
        self._sequence = (self._sequence + 1) % 256
        os.write(self.into, message.frame(self._sequence).pack())

    def wait(self, kind, seconds=10.0, **fields):
        for _ in range(round(1e3 * seconds)):
            self._heard += [read(frame) for frame in self._decoder.feed(available(self._out))]
            while self._heard:
                found = self._heard.pop(0)
                if isinstance(found, kind) and all(getattr(found, key) == fields[key] for key in fields):
                    return found
            self._advance(0.001)
        raise TimeoutError(f"no {kind.__name__} {fields} within {seconds} s")

    def ask(self, message, kind=Acknowledge):
        self.send(message)
        return self.wait(kind, **({"command": message.type} if kind is Acknowledge else {}))


def available(file):
    """Return what there is to read in a pipe."""
    return os.read(file, 65536) if select.select([file], [], [], 0.0)[0] else b""


class Board:
    """The running program: `usb` and `bluetooth` to talk to it, its time `now` in s, `events`."""

    def __init__(self, program, blocking_ms=0, way=1):
        (usb_in, usb_to), (usb_from, usb_out), (noted, notes) = os.pipe(), os.pipe(), os.pipe()
        (air_in, self.air_to), (air_from, air_out) = os.pipe(), os.pipe()
        (time_in, self._time_to), (self._time_from, time_out) = os.pipe(), os.pipe()
        happen_in, self._happen_to = os.pipe()
        theirs = (air_in, air_out, time_in, time_out, happen_in)
        self.process = subprocess.Popen(
            [str(word) for word in (program, blocking_ms, *theirs, way)],
            stdin=usb_in,
            stdout=usb_out,
            stderr=notes,
            pass_fds=theirs,
        )
        for end in (usb_in, usb_out, notes, *theirs):
            os.close(end)
        self.now, self.events, self._noted, self._half = 0.0, [], noted, b""
        times = (self._time_to, self._time_from)
        self._ours = [usb_to, usb_from, noted, self.air_to, air_from, *times, self._happen_to]
        self.usb, self._air = Wire(usb_to, usb_from, self.advance), Wire(self.air_to, air_from, self.advance)

    def connect_bluetooth(self):
        return self._air

    def end_bluetooth(self):
        os.close(self.air_to)
        self._ours.remove(self.air_to)

    def happen(self, what):
        """Let something happen.

        Press the button (b) or release it (B), end the converter's answers (c), hang the FOC task (h), hold the
        cable (p) or cut it (P).
        """
        os.write(self._happen_to, what.encode())
        self.advance(0.001)

    def close(self):
        for end in self._ours:
            os.close(end)
        self.process.wait()

    def advance(self, seconds):
        """Let time pass in the program."""
        os.write(self._time_to, struct.pack("=I", round(1e6 * seconds)))
        self.now += seconds
        assert os.read(self._time_from, 1), "the program has ended"
        *lines, self._half = (self._half + available(self._noted)).split(b"\n")
        for line in lines:
            at, what, number = line.decode().split()
            self.events.append((what, float(number), float(at)))

    def numbers(self, what):
        return [number for name, number, _ in self.events if name == what]

    def times(self, what):
        return [at for name, _, at in self.events if name == what]

    def until(self, what, number, seconds=10.0):
        for _ in range(round(1e3 * seconds)):
            if number in self.numbers(what):
                return
            self.advance(0.001)
        raise TimeoutError(f"no {what} {number}: {self.events}")


@pytest.fixture
def module(program, request):
    made = Board(program, **getattr(request, "param", {}))
    yield made
    ended = made.process.poll()
    made.process.kill()
    made.close()
    assert ended is None


@pytest.fixture
def pulling(module):
    """Return a module that pulls at a cable that is held, at the command of USB."""
    pull(module, module.usb)
    module.until("driver", 1)
    return module


def pull(module, wire, zero=ZERO):
    """Hold the cable, and let the module pull at it with 2 N."""
    module.happen("p")
    assert wire.ask(SetParameter(PARAMETERS["motor_zero"].index, zero)).code is Code.OK
    wire.ask(Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0))
    assert wire.ask(Arm(5, wire.ask(Hello(), Info).stops)).code is Code.OK
    wire.send(SetTension(5, 2.0, ttl_ms=2000))


def test_it_boots_with_the_driver_off_and_each_task_on_its_processor(module):
    assert "no settings in flash" in module.usb.wait(Log).text
    info = module.usb.ask(Hello(), Info)
    assert (info.state, info.reset_reason, info.calibrated) == (State.IDLE, ResetReason.WATCHDOG, False)
    assert info.serial_number == 0xA1B2C3D4
    assert module.events[0][:2] == ("output", 33)  # before all else
    noted = {"driver": [], "offsets_with_driver_on": [], "task_foc": [1], "task_read": [0], "task_write": [0]}
    noted |= {"watchdog_ms": [1000]}  # flash may be written while the driver is off
    noted |= {"announces_at_begin": [0], "pairs": [0], "found": [0]}  # else the core refuses to pair
    noted |= {"servo_us": [1000]}
    assert {what: module.numbers(what) for what in noted} == noted


either_way = pytest.mark.parametrize(
    ("module", "direction"), [({"way": 1}, 1.0), ({"way": -1}, -1.0)], indirect=["module"]
)


@either_way
def test_it_reels_in_whichever_way_round_the_encoder_is(module, direction):
    usb = module.usb
    module.advance(0.6)  # the offsets of the currents, which the radio moved, are found again
    assert usb.ask(SetParameter(PARAMETERS["motor_direction"].index, direction)).code is Code.OK
    before = usb.ask(ConfigureTelemetry(20), Telemetry)
    pull(module, usb)
    module.until("driver", 1)
    assert module.numbers("zero_mrad") == [1e3 * ZERO]
    last = [usb.wait(Telemetry, state=State.RUNNING) for _ in range(15)][-1]
    assert last.tension == pytest.approx(2.0)
    assert last.current == pytest.approx(2.0 / 3.0, rel=0.01)
    assert before.length - last.length == pytest.approx(2.0 / 4000.0, abs=2e-4), "as far as the cable gives"
    assert last.supply == pytest.approx(12.0, abs=0.3), "the radio moves what the converter reads"
    usb.ask(Stop())
    module.until("driver", 0)


@either_way
def test_a_cable_that_is_cut_takes_the_driver_off_within_60_ms(module, direction):
    module.advance(0.6)
    assert module.usb.ask(SetParameter(PARAMETERS["motor_direction"].index, direction)).code is Code.OK
    pull(module, module.usb)
    module.advance(0.5)
    begin = module.now
    module.happen("P")
    assert module.usb.wait(Event).faults == Fault.SPEED
    assert module.events[-1][:2] == ("driver", 0)
    assert module.events[-1][2] - begin < 0.06


@pytest.mark.parametrize("error", [np.pi, 2.1, -2.1])
def test_a_wrong_electrical_zero_takes_the_driver_off_within_60_ms(module, error):
    module.advance(0.6)
    pull(module, module.usb, zero=(ZERO + error) % (2.0 * np.pi))
    assert module.usb.wait(Event, state=State.FAULT).faults == Fault.MOTOR
    on, off = module.times("driver")
    assert off - on < 0.06


def test_the_electrical_zero_is_found_with_the_driver_on_only_meanwhile(module):
    usb = module.usb
    usb.send(Calibrate(Calibration.ENCODER))
    module.until("driver", 1)
    found = usb.wait(Acknowledge)
    assert (found.code, found.state) == (Code.OK, State.IDLE)
    module.until("driver", 0)
    zero = usb.ask(GetParameter(PARAMETERS["motor_zero"].index), ParameterValue).value
    assert zero == pytest.approx(ZERO, abs=0.02)
    on, off = module.times("driver")
    assert 3.0 < off - on < 3.6


def test_an_emergency_stop_ends_the_search_for_the_zero(module):
    usb = module.usb
    usb.send(Calibrate(Calibration.ENCODER))
    module.until("driver", 1)
    assert usb.ask(EmergencyStop()).state is State.ESTOP
    module.until("driver", 0)
    on, off = module.times("driver")
    assert off - on < 1.5
    module.advance(0.2)
    assert module.numbers("driver") == [1, 0]


def test_settings_are_stored_and_the_servo_follows_its_pulse_at_once(module):
    assert module.usb.ask(Save()).code is Code.OK
    assert len(module.numbers("stored")) == 1
    assert module.usb.ask(SetParameter(PARAMETERS["brake_open_pulse"].index, 1200.0)).code is Code.OK
    module.until("servo_us", 1200)


def test_bluetooth_takes_the_link_and_its_end_is_a_link_that_closed(pulling):
    air = pulling.connect_bluetooth()
    assert air.ask(Hello(), Info).state is State.TIMEOUT
    assert air.ask(Stop()).code is Code.OK
    assert air.ask(Arm(6, air.ask(Hello(), Info).stops)).code is Code.OK
    air.send(SetTension(6, 1.0, ttl_ms=2000))
    assert air.ask(Hello(), Info).state is State.RUNNING
    pulling.end_bluetooth()
    pulling.advance(0.01)
    assert pulling.usb.ask(Hello(), Info).state is State.TIMEOUT


@pytest.mark.parametrize("module", [{"blocking_ms": 1000}], indirect=True)
def test_an_emergency_stop_is_heard_while_bluetooth_cannot_send(module):
    module.advance(0.01)  # before its first step, the firmware does not arm
    air = module.connect_bluetooth()
    air.send(Hello())  # its answer blocks the writing task for a second
    module.happen("p")
    air.send(SetParameter(PARAMETERS["motor_zero"].index, ZERO))
    air.send(Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0))
    air.send(Arm(5, stops=1))  # the end of USB's link
    air.send(SetTension(5, 2.0, ttl_ms=2000))
    module.until("driver", 1)
    module.advance(0.1)
    begin = module.now
    air.send(EmergencyStop())
    module.until("driver", 0)
    _, off = module.times("driver")
    assert abs(off - begin) < 0.01


def test_a_flood_does_not_hold_the_loop_up(module):
    usb = module.usb
    for _ in range(20):
        os.write(usb.into, (bytes(reversed(range(256))) + bytes(2)) * 4)  # each piece ends a frame
    usb.ask(ConfigureTelemetry(20))
    telemetry = usb.wait(Telemetry)
    assert telemetry.bad_frames > 60
    assert telemetry.longest_step_us == 250


def test_strangers_pair_only_for_a_while_after_the_button_was_pressed(module):
    module.usb.ask(Hello(), Info)
    module.happen("b")
    module.advance(0.01)
    module.happen("B")
    assert (module.numbers("pairs"), module.numbers("found")) == ([0, 1], [0, 1])
    module.advance(9.9)
    assert module.numbers("pairs") == [0, 1]
    module.advance(0.2)
    assert (module.numbers("pairs"), module.numbers("found")) == ([0, 1, 0], [0, 1, 0])
    assert set(module.numbers("connectable")) == {1}, "those that have paired connect at any time"


def test_a_module_that_pulls_does_not_pair(module):
    module.usb.ask(Hello(), Info)
    module.happen("bB")
    module.happen("b")
    pull(module, module.usb)
    module.until("driver", 1)
    module.advance(0.01)
    assert module.numbers("pairs") == [0, 1, 0], "storing a key would halt the loop"


@pytest.mark.parametrize(("stop", "state"), [(Stop(), State.IDLE), (EmergencyStop(), State.ESTOP)])
def test_a_stop_is_obeyed_from_usb_though_bluetooth_has_the_link(module, stop, state):
    module.advance(0.01)
    air = module.connect_bluetooth()
    pull(module, air)
    module.until("driver", 1)
    available(module.usb._out)  # what it said before Bluetooth was there
    module.usb.send(SetTension(5, 3.0, ttl_ms=2000))
    module.usb.send(Hello())
    module.usb.send(stop)
    module.until("driver", 0, 0.1)
    assert air.wait(Event).state is state
    assert air.ask(Hello(), Info).state is state
    assert available(module.usb._out) == b"", "and nothing else is"


def test_an_emergency_stop_is_obeyed_from_bluetooth_that_has_just_lost_the_link(module):
    module.advance(0.01)
    air = module.connect_bluetooth()
    pull(module, air)
    module.until("driver", 1)
    air.send(EmergencyStop())
    module.end_bluetooth()
    module.until("driver", 0, 0.1)
    assert module.usb.ask(Hello(), Info).state is State.ESTOP


def test_a_hang_takes_the_driver_off_within_the_watchdogs_20_ms_before_the_panic(pulling):
    pulling.advance(0.1)
    assert pulling.numbers("watchdog_ms") == [1000, 20]
    begin = pulling.now
    pulling.happen("h")
    pulling.until("panic", 1, 0.2)
    _, off = pulling.times("driver")
    assert off - begin < 0.023
    assert [what for what, *_ in pulling.events][-2:] == ["driver", "panic"]


def test_a_hang_with_the_driver_off_may_last_a_second(pulling):
    """As long as flash may take to be written."""
    pulling.usb.ask(Stop())
    pulling.until("driver", 0)
    assert pulling.numbers("watchdog_ms") == [1000, 20, 1000]


def test_a_converter_that_does_not_answer_is_a_fault_at_once_and_no_hang(pulling):
    begin = pulling.now
    pulling.happen("c")
    pulling.until("driver", 0, 0.1)
    assert pulling.now - begin < 0.01
    assert pulling.usb.wait(Event, state=State.FAULT).faults & Fault.CURRENT
    assert pulling.numbers("panic") == []
