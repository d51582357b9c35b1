"""The paper keeps the journal's rules, as far as a machine can tell: sections, length, citations, figures."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PAPER = Path(__file__).parents[1] / "paper"
_, HEAD, BODY = (PAPER / "paper.md").read_text(encoding="utf-8").split("---\n", 2)
BIBLIOGRAPHY = (PAPER / "paper.bib").read_text(encoding="utf-8")
# Required by the Journal of Open Source Software since 2026, in its order.
SECTIONS = [
    "Summary",
    "Statement of need",
    "State of the field",
    "Software design",
    "Research impact statement",
    "AI usage disclosure",
    "Acknowledgements",
    "References",
]
NEEDED = {"article": ("journal", "doi"), "inproceedings": ("booktitle",), "misc": ("url",)}


def entries() -> dict[str, tuple[str, dict[str, str]]]:
    """Return the kind and the fields of each entry of the bibliography."""
    found = re.findall(r"^@(\w+)\{([\w:-]+),\n(.*?)^\}$", BIBLIOGRAPHY, re.MULTILINE | re.DOTALL)
    return {
        name: (kind, dict(re.findall(r"^  (\w+) = \{(.*?)\},?$", text, re.MULTILINE)))
        for kind, name, text in found
    }


def test_its_sections_are_those_that_the_journal_requires() -> None:
    assert re.findall(r"^# (.+)$", BODY, re.MULTILINE) == SECTIONS
    assert BODY.split("# References\n")[1].strip() == ""  # the journal fills it


def test_its_length_is_within_the_limits() -> None:
    text = re.sub(r"\]\([^)]*\)|\\\w+\{[^}]*\}|^# .*$", "", BODY, flags=re.MULTILINE)
    assert 750 <= len(re.findall(r"[\w'.,-]*\w[\w'.,-]*", text)) <= 1000


@pytest.mark.parametrize("key", ["title", "tags", "authors", "affiliations", "date", "bibliography"])
def test_its_front_matter_is_complete(key: str) -> None:
    assert re.search(rf"^{key}:", HEAD, re.MULTILINE), key


def test_each_author_has_an_affiliation_that_exists() -> None:
    indices = re.findall(r"^  - index: (\d+)\n    name: .+$", HEAD, re.MULTILINE)
    authors = re.findall(r"^  - name: .+\n    affiliation: (\d+)$", HEAD, re.MULTILINE)
    assert authors
    assert set(authors) <= set(indices)
    assert re.search(r"^date: \d{1,2} [A-Z][a-z]+ \d{4}$", HEAD, re.MULTILINE)


def test_what_is_cited_is_in_the_bibliography_and_the_reverse() -> None:
    assert set(re.findall(r"(?<![\w.])@([\w:-]+)", BODY)) == set(entries())
    assert len(entries()) == BIBLIOGRAPHY.count("\n@") + BIBLIOGRAPHY.startswith("@")


@pytest.mark.parametrize("name", sorted(entries()))
def test_each_entry_says_where_it_was_published(name: str) -> None:
    kind, fields = entries()[name]
    for field in ("author", "title", "year", *NEEDED[kind]):
        assert fields.get(field), f"{name} has no {field}"
    assert re.fullmatch(r"10\.\d{4,}/\S+", fields.get("doi", "10.1000/x")), fields


def test_its_figures_exist_and_are_mentioned() -> None:
    figures = re.findall(r"!\[([^\]]+)\\label\{([\w:]+)\}\]\(([^)]+)\)", BODY)
    assert len(figures) == BODY.count("![") >= 1
    for caption, label, path in figures:
        assert len(caption) > 40
        assert (PAPER / path).is_file(), path
        assert f"\\autoref{{{label}}}" in BODY, label


def test_its_numbers_are_those_of_the_benchmark() -> None:
    page = (PAPER.parent / "docs" / "reference" / "benchmark.md").read_text(encoding="utf-8")
    (count,) = re.findall(r"^([\d,]+) problems in 8 sets", page, re.MULTILINE)
    table = page.split("<!-- bench: start -->")[1].split("<!-- bench: end -->")[0]
    rows = [line for line in table.splitlines() if line.startswith("| ")][2:]
    text = " ".join(BODY.split())
    assert f"thirty-five solvers and settings on {count} seeded problems" in text
    assert len(rows) == 35
