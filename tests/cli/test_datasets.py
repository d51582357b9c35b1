import json

import pytest

import tensionlab as tl
from tensionlab.cli import COMPLETION_VARIABLE


def test_every_data_set_is_listed_with_what_it_is(run):
    code, out, err = run("datasets", "--json")
    assert (code, err) == (0, "")
    listed = json.loads(out)["datasets"]
    assert [f"{each['kind']}/{each['name']}" for each in listed] == tl.datasets.names()
    titles = {each["name"]: each["title"] for each in listed if each["kind"] in {"rigs", "problems"}}
    assert titles["cogiro"] == tl.load_rig("cogiro").description
    assert titles["edge"].startswith("wrenches at most 1 % inside the edge")
    assert all(each["title"] for each in listed)
    code, out, _ = run("datasets", "rigs")
    assert code == 0
    assert "spidar-g6x4" in out
    assert "four-in-a-room" not in out
    assert out.count("\nrigs ") == 1, "the kind heads its rows"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("tensionlab dat", ["datasets"]),
        ("tensionlab compare ipa", ["ipanema-1", "ipanema-2"]),
        ("tensionlab layout search four", ["four-in-a-room"]),
        ("tensionlab scenario b", ["bow"]),
        ("tensionlab serve --scenario w", ["weight"]),
        ("tensionlab problems e", ["edge"]),
        ("tensionlab datasets r", ["rigs", "recordings"]),
        ("tensionlab allocate cube-8 --solver ne", ["newton"]),
        ("tensionlab compare ./ipa", []),  # the shell itself knows files
    ],
)
def test_a_shell_is_told_the_names_that_begin_like_the_word(run, monkeypatch, line, expected):
    monkeypatch.setenv(COMPLETION_VARIABLE, "complete_bash")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
    code, out, err = run()
    assert (code, out.split(), err) == (0, expected, "")
