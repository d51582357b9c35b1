"""Scenarios on modules that are served with the person who holds their cables: on one clock, and once over TCP."""

from contextlib import closing

import pytest

from benchmarks.processes import simulated
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.osc import OscServer
from tensionlab.haptics.bridge.source import tracked_pose
from tensionlab.hardware import RealClock, RunSettings, connect
from tensionlab.scenarios import SCENARIOS, load_scenario
from tensionlab.scenarios.checks import check_directions
from tensionlab.scenarios.expected import check_magnet, check_scenario
from tensionlab.scenarios.person import RETURN_S
from tensionlab.scenarios.play import ScenarioModules, play
from tests.helpers.served_person import ServedPerson

PARTS = {
    "materials": (3.0, check_magnet),
    "collision": (6.2, check_scenario),
    "recoil": (3.2, check_scenario),
    "weight": (3.6, check_scenario),
}
"""How much is played, in s, and who judges it, where that is not all and by `check_scenario`."""
START = [0.5, 0.0, 1.45]  # where the hand is that draws a bow


@pytest.fixture
def served(monkeypatch):
    """Serve the modules of a scenario, and its person."""
    opened = []

    def serve(name):
        opened.append(ServedPerson(load_scenario(name), monkeypatch))
        return opened[-1]

    yield serve
    for each in opened:
        each.simulation.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_is_as_expected_with_a_person_whom_only_the_modules_and_a_tracker_know(served, name):
    seconds, judge = PARTS.get(name, (load_scenario(name).seconds, check_scenario))
    person = served(name)
    found = person.play(seconds)
    assert found.statistics.ended == "duration reached"
    assert not found.statistics.lost
    assert not found.statistics.unconfirmed
    assert not person.ignored
    rows = judge(found)
    assert rows
    for row in rows:
        assert row.met, row
    where = check_directions(found.run)
    assert where.cycles > 0
    assert where.reasons["unexplained"] == 0
    assert where.within + sum(where.reasons.values()) == where.cycles


def drawn(run):
    """When the hand has drawn the bow by 10 cm, in s."""
    return run.time[run.position[:, 0] < START[0] - 0.1][0]


def test_it_can_be_played_again_and_again_without_restarting_the_modules(served):
    """Once the person is back, and on the way back: whom a run finds there begins after that."""
    person = served("bow")
    first = person.play(1.5).run
    person.wait_until(person.now() + RETURN_S + 0.5)
    again = person.play(1.5).run
    for run in (first, again):
        assert check_directions(run).reasons["unexplained"] == 0
        assert run.position[0] == pytest.approx(START, abs=0.01)
        assert run.position[-1][0] < 0.15
    assert drawn(first) == pytest.approx(drawn(again), abs=0.02)

    person.wait_until(person.now() + 0.1)  # until the module has ramped down: it takes no settings before
    second = person.play(2.0).run
    assert second.position[0][0] < 0.4
    assert drawn(second) == 0.0
    back = second.time[second.position[:, 0] > START[0] - 0.01]
    assert back[0] < RETURN_S
    again = second.time[(second.position[:, 0] < START[0] - 0.1) & (second.time > back[0])][0]
    assert RETURN_S - 0.2 < again - drawn(first) < RETURN_S  # it had begun to go back a moment before


def test_who_stood_still_because_the_modules_server_got_no_time_catches_up_with_the_scenario(served):
    ends = []
    for spans in ((), ((0.1, 0.25), (0.3, 0.45))):
        person = served("bow")
        person.starve(*spans)
        ends.append(person.play(1.5).run.position[-1])
    assert ends[0][0] < 0.15
    assert ends[1] == pytest.approx(ends[0], abs=0.01)  # the hand moves by 0.6 m/s, and stood still for 0.26 s


@pytest.mark.slow
@pytest.mark.realtime  # modules in another process, over TCP, and a tracker over UDP
def test_a_scenario_is_played_between_processes(monkeypatch):
    monkeypatch.setattr(
        "tensionlab.scenarios.play._settings", lambda scenario: RunSettings(scenario.rate, 2.0)
    )  # may stand still
    scenario, ignored = load_scenario("bow"), []
    client = ClientState(scenario.rig)
    with (
        OscServer(client, "127.0.0.1", 0, ignored.append) as osc,
        simulated("--scenario", "bow", "--tracker", f"127.0.0.1:{osc.port}") as (links, _),
        closing(connect(scenario.rig, links)) as group,
    ):
        found = play(scenario, ScenarioModules(group, RealClock(), links, tracked_pose(client)), seconds=2.0)
    assert found.statistics.ended == "duration reached"
    assert not ignored
    assert found.run.position[0] == pytest.approx(START, abs=0.01)
    assert check_directions(found.run).reasons["unexplained"] == 0


WRONG = [
    (("--scenario", "bow", "--only", "bow-hand"), "leave out --only and --sensor-port"),
    (("--scenario", "bow", "--sensor-port", "0"), "leave out --only and --sensor-port"),
    (("--tracker", "127.0.0.1:9000"), "give --scenario NAME"),
    (("--scenario", "bow", "--tracker", "9000"), "--tracker is HOST:PORT"),
    (("--scenario", "bow", "--tracker", "nowhere.invalid:9000"), "nowhere.invalid"),
    (("--scenario", "lute"), "no scenario is called 'lute'"),
]


@pytest.mark.parametrize(("words", "why"), WRONG)
def test_options_that_do_not_go_together_are_refused(run, words, why):
    status, out, wrong = run("simulate", *words)
    assert (status, out) == (2, "")
    assert why in " ".join(wrong.replace("│", " ").split())
