"""Colours tell where tensions are between their limits."""

import re

import numpy as np
import pytest

from tensionlab.support.colours import BLUE, FORCE_COLOURS, GREY, RED, ramp, rgb
from tests.helpers.compiled import ROOT


def test_the_ramp_goes_from_blue_at_the_lower_limit_to_red_at_the_upper():
    lower, upper = np.array([0.5, 0.5, 2.0, 0.5]), np.array([6.0, 6.0, 2.0, 6.0])
    found = ramp(np.array([0.5, 6.0, 2.0, np.nan]), lower, upper)
    np.testing.assert_array_equal(found, [rgb(BLUE), rgb(RED), rgb(BLUE), rgb(GREY)])
    middle = ramp(np.array([3.0]), np.array([1.0]), np.array([5.0]))[0]
    assert len(set(middle.tolist())) == 1  # neither blue nor red: nothing is special about the middle
    spans = np.linspace(0.5, 0.5011, 12)  # a cable with little play has the whole ramp, too
    whole = ramp(spans, np.full(12, 0.5), np.full(12, spans[-1])).astype(int)
    assert (np.abs(np.diff(whole, axis=0)).sum(axis=1) > 10).all()


@pytest.mark.parametrize("page", ["tensionlab/haptics/bridge/page.html", "examples/web/page.css"])
def test_pages_without_python_have_the_colours_of_forces(page):
    colours = re.findall(r"--(desired|measured): (#\w+);", (ROOT / page).read_text(encoding="utf-8"))
    assert colours == [(name, FORCE_COLOURS[name].lower()) for name in ("desired", "measured")]
