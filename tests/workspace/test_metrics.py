from types import SimpleNamespace

import numpy as np
import pytest

from tensionlab.errors import SweepError
from tensionlab.workspace import METRICS, metric


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_has_a_description_and_a_title(name):
    assert metric(name) == METRICS[name]
    assert metric(name).description.endswith(".")
    assert metric(name).title


def test_singular_values():
    W = np.array([[[3.0, 0.0, 0.0], [0.0, 2.0, 0.0]], [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]], np.zeros((2, 3))])
    cases = {"least-singular-value": ([2, 0, 0], 0.0), "condition-number": ([1.5, np.inf, np.inf], np.inf)}
    for name, (expected, lost) in cases.items():
        np.testing.assert_allclose(metric(name).evaluate(SimpleNamespace(structure=W)), expected, atol=1e-15)
        one = SimpleNamespace(structure=W[:1].swapaxes(1, 2))  # fewer cables than components
        assert metric(name).evaluate(one).tolist() == [lost]


@pytest.mark.parametrize(
    ("name", "family", "parameters"),
    [
        ("feasible-direction-fraction:2.0", "feasible-direction-fraction", {"magnitude": 2.0}),
        ("capacity-margin:1.5", "capacity-margin", {"radius": 1.5}),
        ("squared-tension:worst", "squared-tension", {"over": "worst"}),
    ],
)
def test_a_variant_sets_the_first_parameter(name, family, parameters):
    assert metric(name) == metric(family, **parameters)
    assert metric(family, **parameters).name == name


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("capacity-margins", {}, "did you mean 'capacity-margin'"),
        ("body-distance:2", {}, "'body-distance' has no variants"),
        ("capacity-margin:much", {}, "'much' is no value for its radius"),
        ("capacity-margin", {"radios": 1.0}, "no parameter 'radios'; did you mean 'radius'"),
    ],
)
def test_odd_names_are_refused(name, parameters, words):
    with pytest.raises(SweepError, match=words):
        metric(name, **parameters)
