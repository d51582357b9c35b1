"""Equations become MathML, and names in docstrings are known or not; where the site's libraries are installed."""

import pytest

pytest.importorskip("sphinx", reason="the extra docs is not installed")

from tools.site.mathml import mathml
from tools.site.references import known


def test_an_equation_is_mathml_with_its_latex_as_words():
    drawn = mathml(r"W t = w", as_block=False)
    assert drawn.startswith('<math alttext="W t = w"')
    assert "<mi>W</mi>" in drawn
    assert "script" not in mathml(r"\lVert t \rVert^2 < 1", as_block=True)


def test_lines_are_aligned():
    assert "<mtable" in mathml(r"a &= b \\ c &= d", as_block=True)


def test_latex_that_nobody_knows_is_refused():
    with pytest.raises(ValueError, match="nosuch"):
        mathml(r"\nosuch{x}", as_block=False)


@pytest.mark.parametrize(
    "name", ["allocate", "tensionlab.allocate", "Rig.structure_matrix", "numpy.ndarray", "newton_kernel.cpp"]
)
def test_names_of_the_package_are_known(name):
    assert known(name)


@pytest.mark.parametrize("name", ["alocate", "Rig.structure_matrx", "no_such_kernel.cpp"])
def test_names_that_are_wrong_are_not(name):
    assert not known(name)
