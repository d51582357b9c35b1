"""The drawing and the table in the firmware's README wire the pins of the board file; the drawing is readable."""

import re
from itertools import combinations, pairwise
from pathlib import Path

from kit import wiring

README = (Path(__file__).parents[2] / "firmware" / "README.md").read_text(encoding="utf-8")


def test_drawing_table_and_board_have_the_same_pins():
    pins = wiring.pins()
    table = {name: int(pin) for pin, name in re.findall(r"\| GPIO (\d+) \|.*`(k\w+)` \|", README)}
    drawn = {text.words for text in wiring.texts()}
    assert table == pins
    assert len(set(pins.values())) == len(pins) == 14
    for pin in pins.values():
        assert any(re.match(rf"GPIO {pin}\b", words) for words in drawn), pin


def test_the_table_names_what_protects_and_feeds():
    section = README.partition("## Wiring")[2].partition("\n## ")[0]
    for symbol in wiring.SYMBOLS:
        assert re.search(rf"\b{symbol.label[0][:2]}\b", section), symbol.label
    for words in (*wiring.SHIELD_PADS.values(), *wiring.ENCODER_PADS.values(), *wiring.SOLDER_PADS):
        assert words.partition(":")[0] in section, words


def test_the_committed_drawing_is_the_generated_one():
    assert wiring.FILE.read_text(encoding="utf-8") == wiring.drawing()


def test_no_label_crosses_another_a_wire_or_an_edge():
    labels = [(text.words, text.bounds()) for text in wiring.texts()]
    for (one, (left, top, right, bottom)), (other, (x, y, far, low)) in combinations(labels, 2):
        assert right <= x or far <= left or bottom <= y or low <= top, (one, other)
    edges = [
        [(b.x, b.y), (b.x + b.width, b.y), (b.x + b.width, b.y + b.height), (b.x, b.y + b.height), (b.x, b.y)]
        for b in wiring.BOXES.values()
    ]
    lines = [pair for corners in (*edges, *(w for _, w in wiring.wires())) for pair in pairwise(corners)]
    for words, (left, top, right, bottom) in labels:
        assert left >= 0
        assert top >= 0
        assert right <= wiring.WIDTH
        assert bottom <= wiring.HEIGHT
        for (x, y), (far, low) in lines:
            beside = max(x, far) <= left or min(x, far) >= right or max(y, low) <= top or min(y, low) >= bottom
            assert beside, (words, (x, y), (far, low))
