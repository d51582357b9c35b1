"""The estimate of temperatures, compared with random motors, rooms and work; and the ratings that follow."""

import json

import pytest

from firmware import ratings

MODULES = 60  # `python firmware/ratings.py` compares 1,000


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return ratings.compile_ratings(tmp_path_factory.mktemp("ratings"))


def test_the_estimate_is_not_colder_than_the_winding_and_no_winding_exceeds_its_class(program):
    found = ratings.measure(program, MODULES)["estimate"]
    assert found["warmer_than_estimated"] <= ratings.TOLERANCE_K
    assert 80.0 < found["winding"] <= ratings.CLASS_LIMIT_C - ratings.TOLERANCE_K
    assert found["driver"] <= 125.0


def test_a_motor_that_cools_worse_than_its_parameters_say_is_warmer_than_estimated(program):
    found = ratings.measure(program, MODULES, factor=2.0)["estimate"]
    assert found["warmer_than_estimated"] > 10.0
    assert found["winding"] > ratings.CLASS_LIMIT_C


def test_the_committed_ratings_are_those_of_this_firmware(program):
    """Else: `python firmware/ratings.py --write`, and `make generated`."""
    committed = json.loads(ratings.FIGURES.read_text(encoding="utf-8"))
    found = ratings.measure(program, MODULES)
    assert committed["continuous"] == pytest.approx(found["continuous"], rel=1e-3)
    for room, currents in found["hold"].items():
        for current, seconds in currents.items():
            assert committed["hold"][room][current] == pytest.approx(seconds, rel=0.01), (room, current)
    assert committed["estimate"]["modules"] == ratings.SEEDS
    for name in ("warmer_than_estimated", "winding", "housing", "driver"):
        assert found["estimate"][name] <= committed["estimate"][name] + 0.1, name
