"""A fixed share of `make file-fuzz`; and that it would find something."""

import random
import signal

import pytest

from tests.stress import file_fuzz
from tests.stress.file_kinds import kinds

COUNT = 10


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    return kinds(tmp_path_factory.mktemp("kinds"))


NAMES = [
    "rig", "space", "scenario", "program", "modules", "parameters", "published values", "directions", "poses, CSV",
    "staircase", "lengths", "forces", "poses, Parquet", "recording", "vectors", "poses, NPZ", "CASPR",
    "journal", "log", "store",
]  # fmt: skip


def test_every_kind_is_here(known):
    assert list(known) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_spoilt_files_are_read_or_refused_in_words(name, tmp_path, monkeypatch):
    monkeypatch.setattr(file_fuzz.signal, "setitimer", lambda *_: None)  # its signal ends who does not expect it
    tally = file_fuzz.fuzz(name, range(COUNT), 1, tmp_path)
    assert tally.findings == []
    assert tally.read + tally.refused == COUNT
    assert tally.refused > 0


def test_the_same_case_is_the_same_file(known):
    one, two = (known["rig"].case(random.Random("0 rig 7")) for _ in range(2))
    assert one == two
    assert one != known["rig"].case(random.Random("0 rig 8"))


@pytest.mark.parametrize(
    ("problem", "said"),
    [
        (KeyError("x"), "KeyError"),
        (file_fuzz.TooSlow(), "more than 10 s"),
        (file_fuzz.TensionlabError("x" * 301), "a message of 301 characters"),
        (MemoryError(), "MemoryError"),
    ],
)
def test_what_must_not_be_is_found(problem, said, tmp_path, monkeypatch):
    monkeypatch.setattr(signal, "setitimer", lambda *_: None)
    calls = []

    def fails(place):
        calls.append(place)
        if len(calls) > 1:
            raise problem

    made = kinds(tmp_path)["modules"]
    object.__setattr__(made, "read", fails)
    monkeypatch.setattr(file_fuzz, "kinds", lambda folder: {"modules": made})
    tally = file_fuzz.fuzz("modules", range(3), 0, tmp_path)
    assert len(tally.findings) == 3
    assert all(said in each for each in tally.findings)
