"""What documents show is what commands print, what committed results say and what the code is."""

import importlib.util
import re
from pathlib import Path

import pytest

from tensionlab.benchmark import comparison
from tensionlab.solvers import SOLVERS, every_solver, make
from tests.helpers.shown import differences

ROOT = Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("generate_docs", ROOT / "tools" / "generate_docs.py")
docs = importlib.util.module_from_spec(spec)
spec.loader.exec_module(docs)

SHOWN = [
    (path.relative_to(ROOT).as_posix(), name, text)
    for path in docs.documents()
    for name, text in docs.blocks(path.read_text(encoding="utf-8"), path.name).items()
]
PRINTED = ["compare"]  # blocks of numbers that differ in their last digits between machines
# Their rows are known by name only: some seconds, and numbers that are their libraries'.
SLOW = ("cvxpy", "qp:clarabel", "qp:osqp", "qp:highs")


@pytest.mark.parametrize(("path", "name", "text"), [each for each in SHOWN if each[1] not in PRINTED])
def test_what_a_document_shows_is_made_anew(path, name, text):
    assert docs.BLOCKS[name]() == text, f"{path}: run `make generated` and look at what changed"


def rows(text):
    """Solver and policy of each row of a shown comparison."""
    return [tuple(line.split()[:2]) for line in re.split("\n─+\n", text)[1].partition("\n\n")[0].splitlines()]


@pytest.mark.parametrize("text", [text for _, name, text in SHOWN if name == "compare"])
def test_the_comparison_has_a_row_for_each_solver(text):
    names = [name for name in every_solver() if name in SOLVERS or name.partition(":")[0] in SOLVERS]
    policies = [(name, make(name).policies or ("–",)) for name in names]
    expected = [(name, "any" if len(supported) > 1 else supported[0]) for name, supported in policies]
    assert rows(text) == expected, "run `make generated`"


@pytest.mark.parametrize("text", [text for _, name, text in SHOWN if name == "compare"])
def test_the_demo_prints_what_the_documents_say(run, monkeypatch, text):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(comparison, "MAX_TIMED_CALLS", 1)  # times are not shown
    left_out = (*SLOW, *(name for name, installed in every_solver().items() if not installed))
    quick = [name for name in dict(rows(text)) if not name.startswith(left_out)]
    code, printed, err = run(*docs.DEMO[:2], "--solvers", ",".join(quick))
    assert (code, err) == (0, "")
    shown = [line for line in text.splitlines() if not line.startswith((*left_out, "plot: "))]
    assert len(quick) > 15
    assert not differences("\n".join(shown), docs.without_times(printed)), "run `make generated`"


def test_every_block_is_shown_somewhere():
    assert set(docs.BLOCKS) == {name for _, name, _ in SHOWN}


def test_what_would_be_wrong_is_seen():
    shown = "solver exact error\nnewton 182 3e-16\nsafe 0 1.25\n"
    assert not differences(shown, "solver  exact error\nnewton   182 2e-15\nsafe 0 1.26\n")
    assert differences(shown, shown + "minimax 182 0\n") == ["3 lines shown, 4 printed"]
    assert differences(shown, shown.replace("182", "181")) == ["newton 182 3e-16"]
    assert differences(shown, shown.replace("1.25", "1.31")) == ["safe 0 1.25"]
    assert differences(shown, shown.replace("3e-16", "3e-5")) == ["newton 182 3e-16"]


def test_blocks_are_filled_wherever_they_stand():
    text = "a\n<!-- bench: start -->\nold\n<!-- bench: end -->\nb `<!-- NAME: start -->` c\n"
    assert docs.blocks(text, "a.md") == {"bench": "old"}
    assert docs.filled(text, "a.md", str.upper) == text.replace("\nold\n", "\n\nBENCH\n\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<!-- bench: start -->\n", "a.md: a mark of a block has no partner"),
        ("<!-- bench: start -->\n<!-- bench: end -->\n<!-- bench: end -->\n", "no partner"),
        ("<!-- bench: start -->\n<!-- compare: end -->\n", "a.md: block 'bench' has no end before"),
        ("<!-- bank: start -->\n<!-- bank: end -->\n", "a.md: nothing makes a block 'bank'; there are compare,"),
    ],
)
def test_a_mark_that_makes_no_sense_is_named(text, message):
    with pytest.raises(ValueError, match=message):
        docs.filled(text, "a.md", str)
