"""The model of the supervisor: its properties hold, errors are found, and the firmware's core does as it does."""

import json
from itertools import count

import pytest

from firmware.check import not_installed
from firmware.model import check
from firmware.model.check import ALL, ENVIRONMENTS, ERRORS, Event, explore, random_run
from tensionlab import _native
from tensionlab.hardware.protocol.codes import PARAMETERS, Calibration, State
from tensionlab.hardware.protocol.messages import (
    Acknowledge,
    Arm,
    Calibrate,
    Clear,
    ConfigureTelemetry,
    Decoder,
    EmergencyStop,
    Hello,
    Message,
    Save,
    SetParameter,
    SetTension,
    Stop,
    Telemetry,
    read,
)
from tests.helpers.modules import armed

needs_spin = pytest.mark.skipif(
    bool(lacking := not_installed(check.TOOLS)), reason=f"not installed: {', '.join(lacking)}"
)
RUNS, STEPS = 40, 6000  # of the model, that are replayed
TICK_MS, STEPS_PER_MS = 300, 4
DISTANCE_M = 1.0
# Times and tensions of the model.
SETTINGS = {"tension_lower": 0.5, "tension_upper": 2.5, "brake_release_tension": 2.0, "ttl": 600.0,
            "brake_travel": 300.0, "brake_dwell": 600.0}  # fmt: skip
COMMANDS = {"estops": EmergencyStop(), "clears": Clear(), "saves": Save(),
            "calibrates": Calibrate(Calibration.NEWTON_PER_AMPERE, 3.0)}  # fmt: skip
# What is not acknowledged; SAVE is when it is done.
SILENT = {("sets", "ok"), ("sets", "stale"), ("saves", "ok")}


def protocol_number(number: int) -> int:
    """The number of 16 bits that stands for one of the model, which has 3."""
    rounds, sequence = divmod(number, 4)
    return rounds * 128 << 8 | sequence * 64


class Core:
    """The firmware's core in a simulated module, to which the events of a run of the model happen.

    What is no command returns "ok"; a command the code that it is acknowledged with, "" if it is not.
    """

    def __init__(self) -> None:
        self.image = b""
        self.numbers, self.new_sessions = count(), count(1)
        self.sessions = {1: 0, 2: 0, 3: 65535}  # those of the model; 3 never arms
        self.quoted = 0  # the count of stops in the host's ARM
        self.armed = 0  # the session of the model that armed last
        self.faults = 0
        self.start()
        for name, value in SETTINGS.items():
            assert self.command(SetParameter(PARAMETERS[name].index, value)) == "ok"
        self.command(Save())
        self.advance(1)
        self.restarts()

    def start(self) -> None:
        self.module = _native.SimulatedModule(1, {}, DISTANCE_M, 0, 0, 0)
        self.decoder = Decoder()
        if self.image:
            assert self.module.load(self.image)
        self.advance(1)  # before its first step, the firmware knows nothing

    def advance(self, steps: int) -> None:
        self.module.advance(steps, DISTANCE_M)

    def hear(self) -> list[Message]:
        return [read(frame) for frame in self.decoder.feed(self.module.transmit())]

    def command(self, message: Message, sequence: int | None = None, in_use: int = 1) -> str:
        self.hear()
        frame = message.frame(next(self.numbers) % 256 if sequence is None else sequence).pack()
        if not in_use:
            self.module.overhear(frame)
            return ""
        self.module.receive(frame, 0)
        codes = [answer.code for answer in self.hear() if isinstance(answer, Acknowledge)]
        return codes[0].name.lower() if codes else ""

    def stops_now(self) -> int:
        """What INFO says, which a host hears by either link."""
        self.hear()
        self.module.receive(Hello().frame(0).pack(), 0)
        (info,) = self.hear()
        return info.stops

    def happen(self, event: Event) -> str:
        if event.name in COMMANDS:
            return self.command(COMMANDS[event.name])
        return getattr(self, event.name)(*event.details)

    def ticks(self, fault: int, *_: int) -> str:
        self.command(ConfigureTelemetry(TICK_MS))
        if fault == 2:
            self.module.set_broken("supply", False)
        # A fault shows after 10 ms. Each is a step later than the one before, so that it never coincides with the
        # end of what that one began.
        last_steps = 20 * STEPS_PER_MS - self.faults if fault == 1 else 0
        self.advance(TICK_MS * STEPS_PER_MS - last_steps)
        if fault == 1:
            self.faults += 1
            self.module.set_broken("supply", True)
        self.advance(last_steps)
        (self.report,) = [message for message in self.hear() if isinstance(message, Telemetry)]
        return "ok"

    def begins(self, *_: int) -> str:
        if self.armed == 1:
            self.sessions[2] = self.sessions[1]
        self.sessions[1] = next(self.new_sessions)
        self.quoted = self.stops_now()
        return "ok"

    def arms(self, whose: int, in_use: int, number: int) -> str:
        session = self.sessions[1] if whose == 1 else next(self.new_sessions)
        quoted = self.quoted if whose == 1 else self.stops_now()
        code = self.command(Arm(session, quoted), protocol_number(number), in_use)
        if code == "ok":
            self.sessions[whose] = session
        return code

    def sets(self, whose: int, in_use: int, content: int) -> str:
        brake, value, number = content // 100, content // 10 % 10, content % 10
        rounds, sequence = divmod(protocol_number(number), 256)
        set_point = SetTension(self.sessions[whose], 0.5 * value, bool(brake), rounds=rounds)
        return self.command(set_point, sequence, in_use)

    def stops(self, in_use: int, *_: int) -> str:
        return self.command(Stop(), None, in_use)

    def limits_to(self, tension: int, *_: int) -> str:
        return self.command(SetParameter(PARAMETERS["tension_upper"].index, 0.5 * tension))

    def closes(self, *_: int) -> str:
        self.module.close_link()
        return "ok"

    def restarts(self, *_: int) -> str:
        self.image = self.module.stored() or self.image
        self.start()
        return "ok"


def disagreement(core: Core, event: Event) -> str:
    """What the model says after an event and what the core does, where they differ."""
    code = core.happen(event)
    core.armed = event.session
    unheard = event.code == "ignored" or (event.name == "stops" and not event.details[0])
    expected = {
        "code": "" if unheard or (event.name, event.code) in SILENT else event.code,
        "state": "timeout" if event.state == "timed_out" else event.state,
        "faulty": event.faulty,
        "tension": 0.5 * event.tension,
    }
    sample = core.module.sample()
    found = {
        "code": code,
        "state": State(sample[9]).name.lower(),
        "faulty": core.module.faults() != 0,
        "tension": round(sample[4], 4),
    }
    if event.name == "ticks":
        expected["brake"], found["brake"] = event.brake, core.report.brake.name.lower()
        if event.state in ("armed", "running"):
            expected["last"], found["last"] = protocol_number(event.last) % 256, core.report.sequence
    return "" if found == expected else f"{event}: the model has {expected}, the core {found}"


def replay(seed: int, error: str = "NONE") -> tuple[str, set[tuple[str, str]]]:
    """Replay a random run: the first disagreement, and which events happened in which states."""
    core, seen, before = Core(), set(), "idle"
    for event in random_run(seed, STEPS, error):
        seen.add((event.name, before))
        if different := disagreement(core, event):
            return different, seen
        before = event.state
    return "", seen


@needs_spin
@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_all_properties_hold_in_as_many_states_as_are_committed(environment):
    """Else: `make model`, and with `--write` `make generated`."""
    found = explore(environment, [ALL])[ALL]
    assert found.holds
    committed = json.loads(check.FIGURES.read_text(encoding="utf-8"))["properties"]
    states = {row["property"]: row["states"] for row in committed if row["environment"] == environment}
    assert states == dict.fromkeys(check.PROPERTIES, found.states)


@needs_spin
def test_an_error_that_is_built_in_is_found():
    error = "SETTINGS_WHILE_PULLING"
    environment, name = ERRORS[error]
    assert not explore(environment, [name], error)[name].holds


@needs_spin
def test_the_core_does_what_the_model_does_in_random_runs():
    seen = set()
    for seed in range(RUNS):
        different, events = replay(seed)
        assert not different, f"seed {seed}: {different}"
        seen |= events
    commands = ("arms", "sets", "stops", "estops", "clears", "closes", "ticks", "restarts")
    states = ("idle", "armed", "running", "timed_out", "fault", "estop")
    assert {(command, state) for command in commands for state in states} - seen == set()


@needs_spin
@pytest.mark.parametrize("error", ["IGNORES_STOPS", "FORGETS_CLOSED_LINKS", "CLOSED_LINK_GOES_ON", "EIGHT_BITS"])
def test_the_core_does_not_what_a_wrong_model_does(error):
    assert any(replay(seed, error)[0] for seed in range(RUNS))


def test_a_number_is_newer_if_it_is_one_of_the_32767_after_the_last():
    """All 65,536, of which the model has 8: a newer one with too much tension is refused, any other is dropped."""
    host = armed()
    host.say(SetTension(host.session, 1.0, rounds=100), sequence=100)
    last = 100 << 8 | 100
    refused = []
    for number in range(1 << 16):
        message = SetTension(host.session, 100.0, rounds=number >> 8)
        if host.say(message, sequence=number & 0xFF):
            refused.append((number - last) % (1 << 16))
    assert sorted(refused) == list(range(1, 1 << 15))
