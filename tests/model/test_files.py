"""Rig files: nothing is lost on the way, and every mistake is named with file, module and key."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.model.files import load_rig, rig_from_toml, rig_to_toml, save_rig
from tensionlab.model.module import KINDS, MAX_LENGTH, Module, Platform
from tensionlab.model.rig import Rig
from tensionlab.support.validation import MAX_PROBLEMS_CHARACTERS
from tests.helpers.examples import many

RIGS = sorted((Path(__file__).parents[2] / "datasets" / "rigs").glob("*.toml"))
GOOD = """
name = "desk"
kind = "point"
home = [0.0, 0.3, 0.0]

[limits]
lower = 0.5
upper = 6.0

[[modules]]
name = "left"
anchor = [-0.5, 0.0, 0.0]

[[modules]]
name = "right"
anchor = [0.5, 0.0, 0.0]
upper = 3.0
"""
FLAT = GOOD.replace('"point"', '"platform"')
finite = st.floats(-MAX_LENGTH, MAX_LENGTH)
positive = st.floats(min_value=0, exclude_min=True, max_value=MAX_LENGTH)
prose = st.text(st.characters(exclude_categories=["Cs"]), min_size=1)
texts = st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=20)


@st.composite
def rigs(draw):
    kind = draw(st.sampled_from(list(KINDS)))
    d, turns = KINDS[kind].dimension, KINDS[kind].turns

    def point():
        return draw(st.lists(finite, min_size=d, max_size=d))

    modules = []
    for name in draw(st.lists(texts, min_size=1, max_size=4, unique=True)):
        lower, upper = sorted(draw(st.tuples(st.floats(0, 1e6), st.floats(0, 1e6))))
        optional = {
            key: draw(st.none() | st.sampled_from([1.5, 2]) | positive)
            for key in (
                "brake",
                "newton_per_ampere",
                "spool_radius",
                "friction_coulomb",
                "friction_viscous",
                "cable_stiffness",
            )
        }
        optional["vibration_gain"] = draw(st.sampled_from([None, [[20.0, 1.2]], [[20.0, 1.25], [50.0, 2.4]]]))
        attachment = point() if turns else None
        frame = draw(st.sampled_from(["world", "hip", "a b"]))
        modules.append(Module(name, point(), lower, upper, attachment=attachment, frame=frame, **optional))
    platform = None
    if turns and draw(st.booleans()):
        platform = Platform(draw(positive), com=point(), inertia=np.eye(turns) * draw(st.floats(1e-3, 1e3)))
    elif draw(st.booleans()):
        platform = Platform(draw(positive))
    return Rig(
        draw(texts),
        kind,
        tuple(modules),
        point(),
        platform,
        draw(st.text('a"\\\n[1.0,]')),
        draw(prose),
        up=draw(st.sampled_from([None, "x", "y", "-y"])),
    )


@settings(max_examples=many(150))
@given(rigs())
def test_a_rig_comes_back_from_its_text(rig):
    assert rig_from_toml(rig_to_toml(rig), source="text") == rig


@pytest.mark.parametrize("path", RIGS, ids=lambda path: path.stem)
def test_every_data_set_comes_back_from_a_file(path, tmp_path):
    rig = load_rig(path)
    assert rig.name == path.stem
    assert rig.description
    assert rig.source
    save_rig(rig, tmp_path / "copy.toml")
    assert load_rig(str(tmp_path / "copy.toml")) == rig


def test_a_saved_file_reads_well():
    text = rig_to_toml(rig_from_toml(GOOD, source="text"))
    assert text == GOOD.lstrip().replace("upper = 6.0\n", "").replace(
        "anchor = [-0.5, 0.0, 0.0]\n", "anchor = [-0.5, 0.0, 0.0]\nupper = 6.0\n"
    )


MISTAKES = {
    "misspelt key": (
        GOOD.replace("anchor", "anchro", 1),
        ['modules[0] ("left")', "anchro is an unknown key", "did you mean 'anchor'?"],
    ),
    "misspelt default": (
        GOOD.replace("lower", "lowr"),
        ["limits.lowr is an unknown key", "did you mean 'lower'?"],
    ),
    "strange key": (
        GOOD + "colour = 1",
        ['modules[1] ("right")', "colour is an unknown key", "the keys here are", "spool_radius"],
    ),
    "number in quotes": (
        GOOD.replace("3.0\n", '"3.0"\n'),
        ['modules[1] ("right")', "upper is", "'3.0'", "in N"],
    ),
    "truth for number": (
        GOOD.replace("lower = 0.5", "lower = true"),
        ["limits.lower is True", "in N"],
    ),
    "name empty": (GOOD.replace('"left"', '""'), ["modules[0].name is ''"]),
    "anchor left out": (
        GOOD.replace("anchor = [0.5, 0.0, 0.0]", ""),
        ['modules[1] ("right")', "anchor is missing"],
    ),
    "limit left out": (
        GOOD.replace("lower = 0.5", ""),
        ['module 1 ("left")', '"lower" is missing', "[limits]"],
    ),
    "twice the name": (GOOD.replace('"right"', '"left"'), ['module "left"', '"name"', "modules 1 and 2"]),
    "lower above upper": (
        GOOD.replace("3.0\n", "0.2\n"),
        ['module "right"', '"lower" is 0.5', '"upper", which is 0.2'],
    ),
    "negative": (
        GOOD.replace("lower = 0.5", "lower = -0.5"),
        ['module "left"', '"lower" is -0.5', "0 or more"],
    ),
    "nan home": (GOOD.replace("0.3", "nan"), ['"home"', "nan"]),
    "flat anchor": (
        GOOD.replace("[-0.5, 0.0, 0.0]", "[-0.5, 0.0]"),
        ['module "left"', '"anchor" has 2', "needs 3"],
    ),
    "attachment of a point": (
        GOOD + "attachment = [0.1, 0, 0]",
        ['module "right"', '"attachment"', "leave it out"],
    ),
    "attachment left out": (FLAT, ['module 1 ("left")', '"attachment" is missing', "platform axes"]),
    "unknown kind": (
        GOOD.replace('"point"', '"pont"'),
        ['"kind"', "'pont'", "planar-point, point, planar, platform"],
    ),
    "no module": (GOOD.split("[[", maxsplit=1)[0], ["modules is missing", "at least one"]),
    "empty modules": (
        "modules = []\n" + GOOD.split("[[", maxsplit=1)[0],
        ["modules has 0 entries", "at least one"],
    ),
    "bad platform": (GOOD + "[platform]\nmass = -1.0", ["[platform]", '"mass" is -1.0', "above zero"]),
    "ragged inertia": (
        GOOD + "[platform]\nmass = 1\ninertia = [1.0]",
        ["platform.inertia[0] is 1.0"],
    ),
    "tension no cable bears": (GOOD.replace("3.0\n", "1e12\n"), ['module "right"', "at most 1e+11 N"]),
    "name with a control character": (GOOD.replace('"left"', '"le\\u001bft"'), ['"name"', "printable"]),
    "long name": (GOOD.replace('"left"', f'"{"l" * 101}"'), ['"name"', "at most 100 printable characters"]),
    "no axis": (GOOD.replace('"point"', '"point"\nup = "w"'), ["\"up\" is 'w'", "x, y, z, -x, -y, -z"]),
    "no TOML": (GOOD + "lower 0.5", ["not valid TOML", "line 18"]),
}


@pytest.mark.parametrize(("text", "words"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_named_with_file_module_and_key(text, words, tmp_path):
    path = tmp_path / "desk.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(RigError) as caught:
        load_rig(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    for word in words:
        assert word in message, message
    # Not a dump of the validator's own words, and no chain of foreign exceptions above it.
    assert "pydantic" not in message
    assert "validation error" not in message
    assert caught.value.__suppress_context__


def test_all_mistakes_of_form_are_told_at_once():
    text = GOOD.replace("anchor", "anchro").replace("lower", "lowr")
    with pytest.raises(RigError, match="5 problems") as caught:
        rig_from_toml(text, source="desk.toml")
    _, *lines = str(caught.value).splitlines()
    assert len(lines) == 5
    assert sum(map(len, lines)) <= MAX_PROBLEMS_CHARACTERS + 2 * len(lines), "without advice"
    keys = "".join(f"key_{number} = 1\n" for number in range(100))
    with pytest.raises(RigError, match=r"100 problems:(?s:.*)and \d+ more$") as caught:
        rig_from_toml(keys + GOOD, source="desk.toml")
    assert len(str(caught.value)) <= 1.3 * MAX_PROBLEMS_CHARACTERS


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(RigError, match=r"none\.toml: no such file"):
        load_rig(tmp_path / "none.toml")
    with pytest.raises(RigError, match=r"is a folder; give a rig file"):
        load_rig(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RigError, match=r"binary\.toml: not UTF-8 text"):
        load_rig(tmp_path / "binary.toml")


def test_pydantic_is_imported_only_to_read_a_file():
    code = "import sys; import tensionlab.model.files; sys.exit('pydantic' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_rest_poses_of_body_frames_are_kept():
    rig = tl.load_rig("body-mounted")
    assert rig.at_rest["shoulder"].position.tolist() == [-0.2, 1.4, 0.0]
    turn = tl.RestPose("hip", [-0.15, 0.95, 0.0], [0.1, 0.2, -0.3])
    rig = dataclasses.replace(rig, rest=(rig.rest[0], turn))
    assert rig_from_toml(rig_to_toml(rig), "again") == rig


@pytest.mark.parametrize(
    ("frames", "error"),
    [
        (
            'name = "knee"\nposition = [0, 1, 0]',
            "carries no module and no body; the frames are shoulder, hip",
        ),
        ('name = "hip"\nposition = [0.0, 1.0]', 'frame "hip": key "position" must have 3 coordinates'),
        (
            'name = "hip"\nposition = [0.0, 1.0, 0.0]\nrotation = [1.0]',
            'frame "hip": key "rotation" must have three',
        ),
        ('name = "hip"\nposition = [0, 1, 0]\nrotation = [0, 0, 150]', "give rad, within 100"),
        ("\n[[frames]]\n".join(2 * ['name = "hip"\nposition = [0, 1, 0]\n']), 'frame "hip" is there twice'),
    ],
)
def test_rest_poses_of_no_use_are_refused(frames, error):
    text = rig_to_toml(dataclasses.replace(tl.load_rig("body-mounted"), rest=()))
    with pytest.raises(tl.errors.RigError, match=error):
        rig_from_toml(text.replace("[[modules]]", f"[[frames]]\n{frames}\n\n[[modules]]", 1), "b.toml")
