"""The bill of materials is complete, dated and below 100 EUR."""

import re
from pathlib import Path

from kit.parts import cost, read_parts, total

README = (Path(__file__).parents[2] / "firmware" / "README.md").read_text(encoding="utf-8")


def test_the_parts_cost_less_than_100_eur():
    assert 80 < total() < 100
    for part in read_parts():
        assert cost(part) > 0, part
        assert re.fullmatch(r"20\d\d-\d\d", part["price_date"])
        assert part["specification"]
        assert part["sold_by"]


def test_every_part_of_the_readme_is_in_the_bill():
    section = README.partition("## Parts")[2].partition("\n## ")[0]
    named = re.findall(r"^\| (.*?) \|", section, re.MULTILINE)[2:]
    bill = " ".join(f"{part['part']} {part['specification']}" for part in read_parts()).lower()
    assert len(named) >= 9
    for part in named:
        for word in re.findall(r"[\w-]{2,}", part):
            assert word.lower() in bill or word in ("and", "for", "the"), (part, word)
