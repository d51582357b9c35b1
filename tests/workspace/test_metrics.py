import pytest

from tensionlab.errors import SweepError
from tensionlab.workspace import metrics
from tensionlab.workspace.interference import Capsule
from tensionlab.workspace.metrics import METRICS


def test_the_distance_to_no_bodies_is_refused():
    with pytest.raises(SweepError, match="no bodies are given"):
        metrics.make("body-distance")


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_has_a_description_a_unit_and_a_name_that_makes_it_again(name):
    metric = metrics.BodyDistance((Capsule([0.0, 0.0]),)) if name == "body-distance" else metrics.make(name)
    assert type(metric) is METRICS[name]
    assert metrics.name_of(metric) == name
    assert metrics.description(metric).endswith(".")
    assert metric.unit
    assert metric.title


@pytest.mark.parametrize(
    ("name", "metric"),
    [
        ("reachable-share:2.0", metrics.ReachableShare(magnitude=2.0)),
        ("capacity-margin:1.5", metrics.CapacityMargin(radius=1.5)),
        ("effort:worst", metrics.SquaredTension(over="worst")),
    ],
)
def test_a_variant_sets_the_first_parameter(name, metric):
    assert metrics.make(name) == metric
    assert metrics.name_of(metric) == name


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("capacity-margins", "did you mean 'capacity-margin'"),
        ("beauty", "choose one of capacity-margin, "),
        ("wrench-closure:2", "'wrench-closure' has no variants"),
        ("body-distance:2", "'body-distance' has no variants"),
        ("reachable-share:much", "'much' is no value for reachable-share's magnitude"),
        ("reachable-share:-1", "magnitude=-1.0"),
        ("capacity-margin:nan", "radius=nan"),
        ("effort:best", "over='best'"),
    ],
)
def test_odd_names_are_refused(name, words):
    with pytest.raises(SweepError, match=words):
        metrics.make(name)
