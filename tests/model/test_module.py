import numpy as np
import pytest

from tensionlab.errors import ShapeError
from tensionlab.model.module import Module, TensionLimits


def test_limits_are_a_read_only_copy():
    lower = np.array([0.5, 0.5])
    limits = TensionLimits(lower, [6, 3])
    lower[0] = 100.0
    assert limits.lower.tolist() == [0.5, 0.5]
    assert limits.upper.tolist() == [6.0, 3.0]
    with pytest.raises(ValueError, match="read-only"):
        limits.upper[0] = 7.0
    with pytest.raises(AttributeError):
        limits.lower = lower


@pytest.mark.parametrize(
    ("lower", "upper", "words"),
    [
        ([0.5, 2.0, 0.5], [6.0, 1.0, 6.0], [r"lower\[1\] = 2 N", r"upper\[1\] = 1 N"]),
        ([0.5, np.nan], [6.0, 6.0], [r"lower\[1\] is nan"]),
        ([0.5, 0.5], [np.inf, 6.0], [r"upper\[0\] is inf"]),
        ([0.5, 0.5], [6.0], [r"\(2,\)", r"\(1,\)"]),
        ([], [], ["no cable"]),
        ([[0.5]], [[6.0]], [r"\(1, 1\)"]),
    ],
)
def test_bad_limits_are_refused_by_name_and_index(lower, upper, words):
    for word in words:
        with pytest.raises(ShapeError, match=word):
            TensionLimits(lower, upper)


def test_all_but_some_cables_are_left_without_tension():
    left = TensionLimits([0.5, 1.0, 2.0], [6.0, 7.0, 8.0]).only(np.array([True, False, True]))
    assert left.lower.tolist() == [0.5, 0.0, 2.0]
    assert left.upper.tolist() == [6.0, 0.0, 8.0]


def test_modules_and_limits_print_what_tells_them_apart():
    assert repr(Module("a", [1, 2, 0], 0.5, 6)) == "<Module a: (1, 2, 0) m, 0.5 to 6 N>"
    assert repr(Module("a", [1, 2, 0], 0.5, 6, frame="hip")) == "<Module a: (1, 2, 0) m on hip, 0.5 to 6 N>"
    assert repr(TensionLimits([1, 1], [5, 5])) == "<TensionLimits of 2 cables: 1 to 5 N>"
    assert repr(TensionLimits([1, 1], [5, 6])) == "<TensionLimits of 2 cables: lower (1, 1) N, upper (5, 6) N>"
