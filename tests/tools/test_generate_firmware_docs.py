"""What the firmware's documents say is what the code says."""

import re
from pathlib import Path

from benchmarks.processes import simulated
from tensionlab.hardware.protocol import codes
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.protocol.messages import Info, Telemetry
from tensionlab.hardware.simulation.simulated_module import TRANSITIONS
from tools import generate_firmware_docs as documents

FIRMWARE = Path(__file__).parents[2] / "firmware"
README = (FIRMWARE / "README.md").read_text(encoding="utf-8")


def test_everything_is_explained():
    assert list(codes._MEANINGS) == list(codes.PARAMETERS)
    assert len(documents.EVENTS) == len(TRANSITIONS)


def test_the_drawing_has_every_way_out_and_none_that_the_table_refuses():
    drawn = set(re.findall(r"(\w+) --> (\w+): ", documents.drawing()))
    ways = {
        (state.name.lower(), to.name.lower())
        for row in TRANSITIONS
        for state, (accepted, to) in zip(State, row, strict=True)
        if accepted and to is not state
    }
    assert drawn == ways
    assert not {begin for begin, end in drawn if end == "running"} - {"armed"}
    assert {begin for begin, end in drawn if end == "armed"} == {"idle"}


def test_what_the_readme_talks_is_understood(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    with simulated() as (links, _):
        exec(code, {"LINK": links["module"]})
    said = capsys.readouterr().out
    assert Info.__name__ in said
    assert said.count(Telemetry.__name__) >= 5


def test_the_files_that_the_readme_names_are_there():
    named = re.findall(r"`((?:core|esp32|plant|stubs|fuzz)/[\w./]*|platformio\.ini)`", README)
    assert len(named) > 5
    for name in named:
        assert (FIRMWARE / name).exists(), name
