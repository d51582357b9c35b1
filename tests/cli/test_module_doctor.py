"""`tensionlab module doctor`, on the ESP32's own firmware with one defect at a time, in a process of its own."""

import json
import subprocess
import sys

import pytest

from tensionlab.hardware.client.links import OPENERS
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.parameter_file import parameters
from tensionlab.hardware.protocol.codes import State
from tests.helpers.defects import DefectLink, compile_programs
from tests.helpers.shared import make_once
from tests.stress import cases

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the fakes are for POSIX")
SEEDS = range(max(cases(1), 1))
READ_ONLY = {  # what is seen at rest, so that nothing may move
    "encoder-dead": ["encoder"],
    "encoder-damaged": ["encoder"],
    "encoder-stuck": ["encoder-stuck"],
    "encoder-noisy": ["encoder-noisy"],
    "converter": ["converter"],
    "supply-off": ["supply-missing"],
    "supply-low": ["supply-low"],
    "supply-high": ["supply-high"],
    "loop": ["loop"],
    "watchdog": ["watchdog"],
    "brownout": ["brownout"],
    "armed": ["armed"],
    "timeout": ["timeout"],
    "fault": ["fault"],
    "estop": ["estop"],
    "load": [],  # no fault, but something may hang on the cable
}
NOT_ARMED = {  # what is seen before, or while the electrical zero is looked for
    "flash-empty": ["flash-empty", "zero"],
    "not-calibrated": ["not-calibrated"],
    "pulses": ["pulses"],
    "zero-60": ["zero"],
    "zero-120": ["zero"],
    "zero-180": ["zero"],
    "slipped": ["zero"],  # as a zero that is wrong: its meaning names both
    "wire": ["wire"],
    "driver": ["driver"],
    "swapped": ["swapped"],
    "poles": ["poles"],
    "held": ["held"],
    "pawl": ["pawl"],
    "shunt": ["shunt"],
    "amplifiers": ["amplifiers"],
    "sign": ["amplifiers"],  # the current is nothing in both cases: their meaning names both
    "supply-weak": ["supply-weak"],
}
ARMED = {
    "none": [],
    "cable-cut": ["runaway"],
    "direction": ["runaway"],  # without a hand, as a cable that nothing holds: its meaning names both
}
DEFECTS = READ_ONLY | NOT_ARMED | ARMED


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return make_once(tmp_path_factory, "dangers", compile_programs) / "served"


@pytest.fixture
def reach(program, monkeypatch):
    """Return the link to a module with a defect, which verbs open as well."""
    links = []

    def open_link(defect, seed=0):
        links.append(link := DefectLink(program, defect, seed))
        monkeypatch.setitem(OPENERS, link.url, lambda: link)
        return link

    yield open_link
    for link in links:
        link.end()


def settings(link):
    """Return the state of a module, and its parameters if it tells them."""
    client = ModuleClient("module", link)
    state = client.hello().state
    return state, parameters(client) if state is State.IDLE else None


def test_every_defect_is_in_these_tables(program):
    names = subprocess.run([program], capture_output=True, text=True, check=True).stdout.split()
    assert set(names) == set(DEFECTS)


@pytest.mark.parametrize("defect", DEFECTS)
@pytest.mark.parametrize("seed", SEEDS)
def test_it_names_the_fault_arms_only_what_is_sound_and_leaves_all_as_it_was(run, reach, defect, seed):
    link = reach(defect, seed)
    before = settings(link)
    link.heard.clear()
    status, out, err = run("module", "doctor", link.url, "--yes", "--json")
    found = json.loads(out)
    assert [check["finding"] for check in found["checks"] if check["finding"]] == DEFECTS[defect]
    assert (status, err, found["healthy"]) == ((1, "", False) if DEFECTS[defect] else (0, "", True))
    assert link.armed == (defect in ARMED or defect == "armed")
    assert link.driven == (defect not in READ_ONLY)
    assert settings(link) == before
    if defect == "armed":
        assert before[0] is State.RUNNING


@pytest.mark.parametrize("seed", range(10, 14))
def test_it_finds_nothing_wrong_with_sound_modules(run, reach, seed):
    link = reach("none", seed)
    status, out, _ = run("module", "doctor", link.url, "--yes")
    assert (status, link.armed) == (0, True)
    assert "✗" not in out
    assert "0 faults found" in out


class Hand:
    """Standard input of a terminal, at which somebody pulls cable out, or does not, before each Enter."""

    def __init__(self, link, pulls):
        self.link, self.pulls = link, pulls

    def readline(self):
        """Pull 80 mm out, then let 30 mm of slack in, the first time."""
        for speed, seconds in ((0.2, 0.4), (-0.15, 0.2)) if self.pulls else ():
            self.link.hand_m_s = speed
            for _ in range(round(seconds / 0.005)):
                self.link.receive(0.005)
        self.link.hand_m_s, self.pulls = 0.0, False
        return "\n"


@pytest.mark.parametrize(
    ("defect", "pulls", "findings"),
    [
        ("none", True, []),
        ("direction", True, ["direction"]),
        ("none", False, ["not-followed"]),
    ],
)
def test_a_hand_tells_the_direction_before_it_is_armed(run, reach, monkeypatch, defect, pulls, findings):
    link = reach(defect)
    monkeypatch.setattr("sys.stdin", Hand(link, pulls))
    _, out, _ = run("module", "doctor", link.url, "--json")
    assert [check["finding"] for check in json.loads(out)["checks"] if check["finding"]] == findings
    assert link.armed == (not findings)


def test_it_only_reads_without_motion_and_asks_before_it(run, reach, monkeypatch):
    link = reach("wire")
    assert run("module", "doctor", link.url, "--no-motion")[0] == 0
    monkeypatch.setattr("sys.stdin", None)
    status, out, err = run("module", "doctor", link.url)
    assert status == 2
    assert "run this in a terminal" in err
    assert "✓ supply" in out
    assert not link.driven


def test_a_module_that_does_not_answer_is_no_fault_and_no_health(run):
    status, out, err = run("module", "doctor", "socket://127.0.0.1:1", "--json")
    assert status == 1
    assert json.loads(out)["healthy"] is False
    assert "cannot be opened" in err
    assert run("module", "doctor", "nonsense")[0] == 2


@pytest.mark.realtime
def test_it_is_a_program_that_reaches_another_over_tcp_as_time_passes(program):
    served = [
        subprocess.Popen([program, defect, "3"], stdout=subprocess.PIPE, text=True) for defect in ("none", "wire")
    ]
    try:
        urls = [f"socket://127.0.0.1:{int(each.stdout.readline())}" for each in served]
        words = [sys.executable, "-m", "tensionlab", "module", "doctor", "--yes", "--json"]
        doctors = [subprocess.Popen([*words, url], stdout=subprocess.PIPE, text=True) for url in urls]
        found = [json.loads(each.communicate(timeout=60)[0]) for each in doctors]
    finally:
        for each in served:
            each.kill()
            each.communicate()
    findings = [[check["finding"] for check in each["checks"] if check["finding"]] for each in found]
    assert findings == [[], ["wire"]]
    assert [each.returncode for each in doctors] == [0, 1]
