"""Make the site's mathematical font: ``python -m tools.site.font STIXMath-Regular.otf``, of Debian's `fonts-stix`.

The font is a part of STIX Math, whose licence (beside it) asks that what is changed has another name. Needs
`fonttools[woff]`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from fontTools import subset
from fontTools.pens.boundsPen import BoundsPen
from fontTools.ttLib import TTFont

NAME = "Tensionlab Math"
FILE = Path(__file__).parents[2] / "docs" / "static" / "fonts" / "tensionlab-math.woff2"
# What equations here are made of, and some more: letters, Greek, marks, arrows, operators, brackets, alphabets.
CHARACTERS = """20-7e a0-ff 300-338 370-3ff 2010-205f 2070-209f 20d0-20ff 2100-214f 2190-22ff 2308-230b 239b-23b7
    27e6-27ef 1d400-1d467 1d49c-1d503 1d538-1d56b 1d6a4-1d7ff"""
SLANTED, GAP = ((0x1D434, 0x1D467), (0x1D6E2, 0x1D71B), (0x210E, 0x210E)), 15  # letters; units behind their ink
NAMES = (1, 3, 4, 6, 16, 18, 20)  # records of the table of names that hold the name of the font


def widen(font: TTFont) -> None:
    """Have slanted letters end before the next one begins: browsers know no other correction between letters."""
    glyphs, widths = font.getGlyphSet(), font["hmtx"].metrics
    for code, name in font.getBestCmap().items():
        if any(first <= code <= last for first, last in SLANTED):
            pen = BoundsPen(glyphs)
            glyphs[name].draw(pen)
            width, bearing = widths[name]
            widths[name] = max(width, round(pen.bounds[2]) + GAP), bearing


def make(source: Path) -> None:
    """Write the part of a font that equations need, under its new name."""
    font = TTFont(source)
    options = subset.Options(layout_features=["*"], name_IDs=["*"], notdef_outline=True, drop_tables=["FFTM"])
    part = subset.Subsetter(options)
    ends = [[int(end, 16) for end in each.split("-")] for each in CHARACTERS.split()]
    part.populate(unicodes=[code for first, last in ends for code in range(first, last + 1)])
    part.subset(font)
    widen(font)
    for record in font["name"].names:
        if record.nameID in NAMES:
            record.string = NAME.replace(" ", "") if record.nameID == 6 else NAME
    drawings = font["CFF "].cff
    drawings.fontNames = [NAME.replace(" ", "")]
    drawings.topDictIndex[0].FullName = drawings.topDictIndex[0].FamilyName = NAME
    font.flavor = "woff2"
    FILE.parent.mkdir(exist_ok=True)
    font.save(FILE)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make the site's mathematical font.")
    parser.add_argument("source", type=Path, help="STIXMath-Regular.otf")
    make(parser.parse_args().source)
