import dataclasses

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import RigError
from tensionlab.model.files import rig_from_toml, rig_to_toml
from tensionlab.model.kinematics import exponential
from tensionlab.model.requirement import as_requirement

COGIRO, PLANAR, POINT = (tl.load_rig(name) for name in ("cogiro", "kntu-planar", "cube-8"))


def test_the_weight_has_no_torque_about_the_centre_of_mass_however_the_platform_is_turned():
    rotation = exponential(np.random.default_rng(0).normal(size=(20, 3)))
    held = tl.Requirement(gravity=True).middle(COGIRO, rotation)
    arm = rotation @ COGIRO.platform.com
    np.testing.assert_allclose(held[:, :3], np.tile([0.0, 0.0, 9.81 * 91.058], (20, 1)))
    np.testing.assert_allclose(held[:, 3:], np.cross(arm, held[:, :3]), atol=1e-9)


def test_the_weight_of_a_bar_in_the_plane_turns_with_it():
    bar = dataclasses.replace(PLANAR, platform=tl.Platform(2.0, com=[0.3, 0.0]))
    level, upright = bar.gravity([0.0, np.pi / 2])
    np.testing.assert_allclose(level, [0.0, -19.62, -0.3 * 19.62])
    np.testing.assert_allclose(upright, [0.0, -19.62, 0.0], atol=1e-12)


def test_a_box_has_a_corner_for_each_choice_of_ends():
    found = tl.Requirement(wrench=[1.0, 0.0, 5.0], box=[1.0, 0.0, 2.0]).at(POINT)
    assert sorted(found.tolist()) == [[0.0, 0.0, 3.0], [0.0, 0.0, 7.0], [2.0, 0.0, 3.0], [2.0, 0.0, 7.0]]


def test_arrays_are_a_wrench_the_vertices_of_a_set_or_a_ball():
    assert as_requirement([1.0, 2.0, 3.0]) == tl.Requirement(wrench=[1.0, 2.0, 3.0])
    assert as_requirement(np.eye(3)) == tl.Requirement(wrenches=np.eye(3))
    assert as_requirement((np.zeros(3), 2.0)) == tl.Requirement(wrench=np.zeros(3), ball=2.0)
    np.testing.assert_array_equal(as_requirement(np.eye(3)).at(POINT), np.eye(3))


def test_nothing_is_required_of_a_rig_that_does_not_say_so():
    assert not POINT.required
    np.testing.assert_array_equal(POINT.required.at(POINT), [[0.0, 0.0, 0.0]])
    assert not tl.Requirement(wrench=[0.0, 0.0, 0.0], length=2.0)
    assert tl.Requirement(ball=1.0)
    assert COGIRO.required


@pytest.mark.parametrize(
    "required",
    [
        tl.Requirement(gravity=True, box=[10.0, 10.0, 10.0, 0.0, 0.0, 1.5], length=0.5),
        tl.Requirement(wrench=[0, 0, 5, 0, 0, 0], ball=2.5),
        tl.Requirement(wrenches=np.eye(6)),
    ],
    ids=["box", "ball", "list"],
)
def test_a_rig_file_keeps_what_is_required_and_a_file_of_its_own_says_the_same(required, tmp_path):
    rig = dataclasses.replace(COGIRO, required=required)
    text = rig_to_toml(rig)
    assert rig_from_toml(text, "again") == rig
    table = text.partition("[required]\n")[2].partition("\n\n")[0]
    (tmp_path / "required.toml").write_text(table)
    assert tl.load_requirement(tmp_path / "required.toml") == required


def test_the_characteristic_length_is_the_mean_distance_of_attachments_unless_it_is_given():
    assert COGIRO.characteristic_length == pytest.approx(np.sqrt((COGIRO.attachments**2).sum(axis=1).mean()))
    assert dataclasses.replace(COGIRO, required=tl.Requirement(length=0.7)).characteristic_length == 0.7
    assert POINT.characteristic_length == 1.0


@pytest.mark.parametrize(
    ("keys", "error"),
    [
        ({"box": [1.0, -1.0, 0.0]}, 'key "box" is .*; give half of each edge'),
        ({"box": [1.0], "wrenches": [[1.0]]}, 'keys "box" and "wrenches" are both there'),
        ({"wrench": [1.0, 2.0], "box": [1.0]}, '"wrench" has 2 components and key "box" has 1'),
        ({"wrench": [0.0, -1.1e11]}, "each within 1e[+]11"),
        ({"wrench": [np.nan]}, 'key "wrench" is .*; give a list of numbers in N'),
        ({"wrenches": np.ones((100_001, 1))}, "has 100,001 wrenches; give 100,000 at most"),
        ({"wrenches": [1.0, 2.0]}, 'key "wrenches" is .*; give a list of wrenches'),
        ({"wrenches": [[1.0], [1.0, 2.0]]}, 'key "wrenches" is .*; give a list of wrenches'),
        ({"ball": -1.0}, 'key "ball" is -1.0; give a radius'),
        ({"length": 0.0}, 'key "length" is 0.0; give a length in m'),
    ],
)
def test_what_is_no_requirement_is_refused(keys, error):
    with pytest.raises(RigError, match=error):
        tl.Requirement(**keys)


def test_a_rig_refuses_wrenches_of_another_size_and_a_weight_that_it_does_not_know():
    with pytest.raises(RigError, match=r'key "wrench" has 2 components; cube-8, a point rig, needs 3'):
        dataclasses.replace(POINT, required=tl.Requirement(wrench=[1.0, 2.0]))
    with pytest.raises(RigError, match=r'its file needs \[platform\] with a "mass"'):
        dataclasses.replace(COGIRO, platform=None)
    with pytest.raises(RigError, match=r'its file needs "up"'):
        dataclasses.replace(COGIRO, up=None)


def test_files_that_are_none_are_refused_by_name_and_key(tmp_path):
    path = tmp_path / "required.toml"
    path.write_text("bal = 3.0\n")
    with pytest.raises(RigError, match=r"required.toml: bal is an unknown key; did you mean 'ball'"):
        tl.load_requirement(path)
    path.write_text("ball = -3.0\n")
    with pytest.raises(RigError, match=r'required.toml: key "ball" is -3.0'):
        tl.load_requirement(path)
    text = rig_to_toml(POINT).replace("[[modules]]", "[required]\nball = -1.0\n\n[[modules]]", 1)
    with pytest.raises(RigError, match=r'cube.toml: \[required\]: key "ball"'):
        rig_from_toml(text, "cube.toml")
