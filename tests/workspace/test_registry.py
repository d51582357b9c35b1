import pytest

from tensionlab.errors import SweepError
from tensionlab.workspace import metrics as questions
from tensionlab.workspace import registry as catalogue
from tensionlab.workspace.registry import MEASURES


@pytest.mark.parametrize("name", MEASURES)
def test_every_measure_has_a_question_a_unit_and_a_name_that_makes_it_again(name):
    measure = catalogue.make(name)
    assert type(measure) is MEASURES[name]
    assert catalogue.name(measure) == name
    assert catalogue.question(measure).partition("?")[1]
    assert measure.unit
    assert measure.title


@pytest.mark.parametrize(
    ("name", "measure"),
    [
        ("reachable-share:2.0", questions.ReachableShare(magnitude=2.0)),
        ("capacity-margin:1.5", questions.CapacityMargin(radius=1.5)),
        ("effort:worst", questions.SquaredTension(over="worst")),
    ],
)
def test_a_variant_sets_the_first_parameter(name, measure):
    assert catalogue.make(name) == measure
    assert catalogue.name(measure) == name


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
        catalogue.make(name)
