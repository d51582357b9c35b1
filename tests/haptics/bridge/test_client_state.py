import numpy as np
import pytest

from tensionlab.errors import EffectError
from tensionlab.haptics.bridge.client_state import ClientState
from tensionlab.haptics.bridge.command import FrameRefused
from tensionlab.haptics.bridge.messages import Frame
from tensionlab.model import kinematics
from tests.helpers.runs import four


def frame(time, *position, effects=None, rotation=None):
    body = {"position": position} | ({} if rotation is None else {"rotation": rotation})
    return Frame.model_validate({"time": time, "bodies": {"hand": body}, "effects": effects})


def test_between_two_frames_a_hand_moves_evenly_one_frame_behind_and_then_for_as_long_again():
    box = ClientState(four())
    box.put(frame(10.0, 0.0, 0.0, 0.0), 100.0)
    box.put(frame(10.02, 0.02, 0.0, 0.0), 100.02)
    for age, x in ((0.0, 0.0), (0.01, 0.01), (0.02, 0.02), (0.03, 0.03), (0.05, 0.02)):
        motion = box.motion("hand", 100.02 + age)
        np.testing.assert_allclose(motion.position, [x, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(box.motion("hand", 100.03).velocity, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(box.motion("hand", 100.07).velocity, 0.0)


def test_a_hand_moves_evenly_though_its_frames_come_unevenly():
    sent = np.arange(200) / 90.0
    came = np.maximum.accumulate(sent + np.random.default_rng(1).uniform(0.003, 0.012, 200))
    box, number, places, times = ClientState(four()), 0, [], np.arange(0.5, 2.0, 0.005)
    for now in times:
        while came[number] <= now:
            box.put(frame(5.0 + sent[number], 0.4 * sent[number], 0.3, 0.0), came[number])
            number += 1
        places.append(box.motion("hand", now).position[0])
    np.testing.assert_allclose(np.diff(places) / 0.005, 0.4, atol=0.1)
    np.testing.assert_allclose(places, 0.4 * times, atol=0.4 * 0.025)


@pytest.mark.parametrize(("gap", "place"), [(0.11, 0.1), (0.01, 0.15)])
def test_a_gap_or_a_leap_is_no_motion(gap, place):
    box = ClientState(four())
    box.put(frame(10.0, 0.0, 0.0, 0.0), 100.0)
    box.put(frame(10.0 + gap, place, 0.0, 0.0), 100.0 + gap)
    motion = box.motion("hand", 100.002 + gap)
    np.testing.assert_allclose(motion.position, [place, 0.0, 0.0])
    np.testing.assert_allclose(motion.velocity, 0.0)


def test_time_that_goes_back_is_refused_unless_no_frame_has_come_for_a_second():
    box = ClientState(four())
    box.put(frame(10.0, 0.0, 0.0, 0.0), 100.0)
    with pytest.raises(FrameRefused, match="time is 9, before 10 of the previous frame; give s by a clock"):
        box.put(frame(9.0, 0.01, 0.0, 0.0), 100.01)
    box.put(frame(9.0, 0.01, 0.0, 0.0), 101.0)
    assert np.isfinite(box.motion("hand", 101.0005).velocity).all()
    np.testing.assert_allclose(box.motion("hand", 101.01).position, [0.01, 0.0, 0.0])


def test_a_quaternion_turns_about_its_axis_and_is_a_unit_one_within_a_thousandth():
    box, rng = ClientState(four()), np.random.default_rng(1)
    for vector in (*np.pi * np.eye(3), *2 * np.pi * np.eye(3), *rng.uniform(-3.0, 3.0, (20, 3))):
        angle = np.linalg.norm(vector)
        quaternion = *np.sin(angle / 2) * vector / angle, np.cos(angle / 2)
        for scale in (1.0, -1.0009):
            box.put(frame(0.0, 0.0, 0.0, 0.0, rotation=tuple(scale * float(each) for each in quaternion)), 0.0)
            turn = box.motion("hand", 0.0).rotation
            np.testing.assert_allclose(turn, kinematics.exponential(vector), atol=1e-12)
    for wrong in ((0.0, 0.0, 0.0, 0.998), (0.8, 0.602, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)):
        with pytest.raises(ValueError, match=r"has the length .*; give a unit quaternion"):
            frame(0.0, 0.0, 0.0, 0.0, rotation=wrong)


def test_effects_stay_until_others_are_named_and_a_bad_frame_changes_nothing():
    box = ClientState(four())
    box.put(frame(0.0, 0.0, 0.0, 0.0, effects={"a": {"kind": "wall", "stiffness": 50.0}}), 0.0)
    box.put(frame(0.1, 0.1, 0.0, 0.0), 0.1)
    assert box.effects["a"].stiffness == 50.0
    with pytest.raises(EffectError, match="colour is an unknown key"):
        box.put(frame(0.2, 0.2, 0.0, 0.0, effects={"b": {"kind": "wall", "colour": 1}}), 0.2)
    assert list(box.effects) == ["a"]
    np.testing.assert_allclose(box.motion("hand", 5.0).position, [0.1, 0.0, 0.0])
    box.put(frame(0.3, 0.0, 0.0, 0.0, effects={}), 0.3)
    assert not box.effects
