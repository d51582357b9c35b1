"""One door for files from outside: bounds, encoding, nesting, numbers; and messages that are short."""

import os
import re
import threading

import pytest

import tensionlab as tl
from tensionlab.errors import InputError, RigError, ShapeError
from tensionlab.hardware import load_modules, read_run
from tensionlab.scenarios.scenario import load_scenario
from tensionlab.support.files import reading
from tensionlab.support.files.reading import brief, parse_json, parse_toml, read_bytes, read_text, read_toml


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda path: None, "no such file; give the path of a rig file"),
        (lambda path: path.mkdir(), "is a folder; give a rig file"),
        (lambda path: path.write_bytes(b"x" * 2_000_000), "has more than 1,000,000 bytes; give a rig file"),
        (lambda path: path.write_bytes(b"\xff\xfea\x00"), "not UTF-8 text; save it as UTF-8"),
        (lambda path: path.symlink_to("/dev/zero"), "has more than 1,000,000 bytes"),
        (lambda path: path.symlink_to(path), "cannot be read"),
    ],
)
def test_what_is_no_text_is_refused_by_name(tmp_path, make, said):
    path = tmp_path / "x.toml"
    make(path)
    with pytest.raises(RigError, match=rf"x\.toml: {said}"):
        read_text(path, "a rig file (*.toml)", RigError)


def test_a_name_that_no_system_takes_is_refused():
    with pytest.raises(RigError, match=r"'a\\x00b': cannot be read"):
        read_bytes("a\0b", "a rig file", RigError)


@pytest.mark.parametrize("read", [tl.load_rig, tl.load_requirement, load_scenario, load_modules, read_run])
def test_what_is_no_path_is_refused(read):
    for given in (["floor-3"], 3, None, b"floor-3"):
        with pytest.raises(InputError, match=re.escape(f"{given!r} is no path; give one as text or as a Path")):
            read(given)


def test_a_pipe_is_read_like_a_file(tmp_path):
    """As the shell makes one of ``<(program)``."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(b"a = 1",))
    writer.start()
    assert read_toml(pipe, "a rig file", RigError) == {"a": 1}
    writer.join()


def test_a_byte_order_mark_does_no_harm(tmp_path):
    (tmp_path / "x.toml").write_bytes(b"\xef\xbb\xbfa = 1")
    assert read_toml(tmp_path / "x.toml", "a rig file", RigError) == {"a": 1}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = " + "[" * 3000 + "]" * 3000, "nested too deep"),
        ("a = " + "9" * 5000, "not valid TOML: Exceeds the limit"),
        ("a = 1\na = 2", "not valid TOML: Cannot overwrite a value"),
        ('a = "\\ud800"', "not valid TOML"),
        ("a = 2026-02-30T00:00:00Z", "not valid TOML"),
    ],
)
def test_toml_that_is_not_valid_is_refused(text, said):
    with pytest.raises(ShapeError, match=f"x: .*{said}") as refused:
        parse_toml(text, "x", ShapeError)
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "9" * 5000, "[1", b"\xff"])
def test_json_that_is_not_valid_is_refused(text):
    with pytest.raises(ShapeError, match=r"^x: "):
        parse_json(text, "x", ShapeError)


def test_values_in_messages_are_short():
    for value in ("x" * 10_000, [[1.0] * 1000] * 1000, {str(i): i for i in range(1000)}, b"\x00" * 1000, 10**4000):
        assert len(brief(value)) <= reading.MAX_SHOWN
    assert brief([0.0, 0.3, 0.0]) == "[0.0, 0.3, 0.0]"
    assert len(brief(["x" * 30] * 4)) == reading.MAX_SHOWN


@pytest.mark.parametrize(("size", "whole"), [(5, True), (70, True), (90, False), (150, False)])
def test_what_a_parser_says_is_told_whole_unless_it_is_long(size, whole):
    with pytest.raises(ShapeError) as caught:
        parse_toml(f"[{'x' * size}]\n" * 2, "it", ShapeError)
    assert ("(at line 2" in str(caught.value)) == whole
    assert ("…; correct it" in str(caught.value)) != whole
    assert len(str(caught.value)) <= 120 + len("it: not valid TOML: ; correct it")
