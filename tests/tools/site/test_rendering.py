"""Equations become MathML, names in docstrings are known or not, and cards have pictures."""

import re
from pathlib import Path

import pytest

pytest.importorskip("sphinx", reason="the extra docs is not installed")

from tools.site.cards import PAGES, PICTURES, ROOT, SIZE, draw
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


def test_every_tutorial_and_how_to_has_a_card_with_a_part_of_a_picture():
    lists = [(ROOT / f"{page}.md").read_text(encoding="utf-8") for page in PAGES]
    linked = {
        Path(target).stem for text in lists for target in re.findall(r"^- \[.+?\]\((.+?)\): ", text, re.MULTILINE)
    }
    pages = [*(ROOT / "notebooks").glob("*.ipynb"), *(ROOT / "docs" / "how-to").glob("*.md")]
    assert set(PICTURES) == linked == {path.stem for path in pages} - {"index"}
    for source, part in PICTURES.values():
        low, high = min(draw(source, part).getextrema())
        assert draw(source, part).size == SIZE
        assert low < high, source
