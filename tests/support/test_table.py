"""How results show themselves: in one line, in HTML, as tables of pandas and xarray; and names to complete."""

import functools
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.benchmark.comparison import compare
from tensionlab.benchmark.problem_sets import problem_set
from tensionlab.errors import MissingDependency
from tensionlab.hardware import read_run
from tensionlab.hardware.log.reader import recount
from tensionlab.scenarios import load_scenario
from tensionlab.support.formatting import format_duration, format_number, format_range, format_vector, one_line
from tensionlab.support.table import MAX_HTML_ROWS, STATUS_MARKS, Column, Finding, Table, findings_table
from tensionlab.workspace.layout.results import Layout, LayoutSearch, Objective
from tests.helpers.runs import four, logged

STRUCTURE = np.array([[1.0, -1.0]])
LIMITS = (0.5, 6.0)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (2.5, "2.5 s"),
        (0.0123, "12 ms"),
        (9.996e-4, "1 ms"),
        (1.5e-6, "1.5 µs"),
        (3.2e-7, "320 ns"),
        (-1e-10, "0 ns"),
        (1.2e-4, "120 µs"),
    ],
)
def test_times_have_the_unit_that_suits_them(seconds, text):
    assert format_duration(seconds) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (1.2345, "1.23"), (12.345, "12.3"), (123.45, "123"), (0.12345, "0.12"),
        (0.012345, "0.012"), (0.0012, "0.001"), (4e-4, "4e-4"), (1e-12, "1e-12"),
        (-0.5, "-0.50"), (float("nan"), "–"),
    ],
)  # fmt: skip
def test_numbers_are_short(value, text):
    assert format_number(value) == text


def test_a_vector_shows_no_rounding_errors_and_a_long_one_its_ends():
    assert format_vector([1.0, -4e-17, 0.25]) == "(1, 0, 0.25)"
    assert format_vector(np.arange(20.0)) == "(0, 1, 2, 3, …, 18, 19)"
    assert format_vector(range(9)) == "(0, 1, 2, 3, …, 7, 8)"
    assert format_vector([*range(7), 5e-4]) == "(0, 1, 2, 3, 4, 5, 6, 0.0005)"
    assert format_vector([]) == "()"


def test_a_range_is_of_the_finite_numbers():
    assert format_range([0.5, np.nan], [[6.0, np.inf]]) == "0.5 to 6"
    assert format_range([2.0, 2.0]) == "2"
    assert format_range([np.nan]) == format_range([]) == "–"


def test_a_message_is_one_printable_line_without_its_middle_if_it_is_long():
    assert one_line("two:\n\n  words \x1b and\nmore") == "two: words \\x1b and; more"
    assert one_line("0123456789" * 3, 30) == "0123456789" * 3
    assert one_line("0123456789" * 4, 30) == "012345678901234 ... 0123456789"


def words(html):
    """Return the cells of a table in HTML, row by row."""
    rows = re.findall(r"<tr>(.*?)</tr>", html)
    cells = [re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row) for row in rows]
    return [[re.sub("<br>", " ", re.sub("</?span.*?>", "", cell)) for cell in row] for row in cells]


def test_every_status_has_a_shape_of_its_own_and_the_colour_of_the_figures():
    assert len({mark.shape for mark in STATUS_MARKS}) == len(tl.Status)
    html = Table(["status"], [[status] for status in tl.Status])._repr_html_()
    for mark in STATUS_MARKS:
        assert [str(mark)] in words(html)
        assert mark.colour in html


TABLE = Table(
    ["module", "what it is", Column("tension", "N", ".2f"), "vector", "held", "", Column("p99", wide=True)],
    [
        ["a<b", "one of three modules on the floor, 0.3 m apart", 12345.0, np.array([1.0, 2.0]), True, None, 1],
        ["100 %|2", "", float("nan"), None, False, None, 12345],
    ],
    "two modules",
    ["the note"],
)


def test_a_table_on_a_terminal_fits_its_width_and_wraps_texts_between_words():
    assert TABLE.to_text(120).splitlines() == [
        "two modules",
        "                                                          tension",
        "module   what it is                                           (N)  vector  held      p99",
        "─" * 88,
        "a<b      one of three modules on the floor, 0.3 m apart  12345.00  (1, 2)  ✓ yes       1",
        "100 %|2                                                         –       –  ✗ no   12,345",
        "",
        "the note",
    ]
    narrow = TABLE.to_text(60).splitlines()
    assert max(map(len, narrow)) <= 60
    assert "p99" not in "".join(narrow)
    assert any(line.endswith("0.3 m") or "0.3 m " in line for line in narrow)  # a number keeps its unit


@pytest.mark.parametrize(("width", "gap"), [(37, 2), (36, 1), (20, 1)])
def test_narrow_tables_have_narrow_gaps(width, gap):
    lines = Table(["n", "text"], [[1234, "word " * 20]]).to_text(width).splitlines()
    assert lines[1] == "─" * width
    assert lines[2].startswith("1,234" + " " * gap + "word")


def test_texts_and_headings_are_never_narrower_than_they_can_be_read():
    assert Table(["n", "text"], [[1234, "word " * 20]]).to_text(9).splitlines()[1] == "─" * 18
    assert Table(["a b c d e f"], [[1]]).to_text().splitlines()[:3] == ["a b", "c d", "e f"]


def test_findings_pass_fail_or_are_noted():
    findings = [Finding("one", True, "is"), Finding("two", False, "is not"), Finding("three", None, "may be")]
    lines = findings_table("all", findings).to_text().splitlines()[3:]
    assert [line.split("  ")[0] for line in lines] == ["✓ yes", "✗ no", "note"]


def test_in_a_notebook_numbers_stand_on_the_right_on_one_line():
    html = Table(["text", "number"], [["a", 1.0]])._repr_html_()
    cells = re.findall(r'<(t[hd]) style="text-align:(\w+);[^"]*vertical-align:(\w+)([^"]*)">', html)
    assert [cell[:3] for cell in cells] == [
        ("th", "left", "bottom"), ("th", "right", "bottom"), ("td", "left", "top"), ("td", "right", "top"),
    ]  # fmt: skip
    assert ["nowrap" in cell[3] for cell in cells] == [False, False, False, True]


def test_a_table_in_a_notebook():
    html = TABLE._repr_html_()
    assert words(html) == [
        ["module", "what it is", "tension (N)", "vector", "held", "p99"],
        ["a&lt;b", "one of three modules on the floor, 0.3 m apart", "12345.00", "(1, 2)", "✓ yes", "1"],
        ["100 %|2", "", "–", "–", "✗ no", "12,345"],
    ]
    assert "two modules" in html
    assert "the note" in html


def test_a_table_in_markdown():
    lines = TABLE.to_markdown().splitlines()
    assert lines[:2] == [
        "| module | what it is | tension (N) | vector | held | p99 |",
        "| :-- | :-- | --: | --: | :-- | --: |",
    ]
    assert lines[3] == "| 100 %\\|2 |  | – | – | ✗ no | 12,345 |"
    assert lines[-1] == "the note"


def test_a_table_as_a_data_frame_keeps_the_numbers():
    assert TABLE.to_pandas()["tension (N)"][0] == 12345.0


def test_a_long_table_in_a_notebook_leaves_out_its_middle():
    rows = words(Table(["n"], [[i] for i in range(1000)])._repr_html_())
    assert len(rows) == 1 + MAX_HTML_ROWS + 1
    assert rows[1 + MAX_HTML_ROWS // 2] == ["… 960 more"]
    assert (rows[1], rows[-1]) == (["0"], ["999"])
    assert ["… 1 more"] in words(Table(["n"], [[i] for i in range(MAX_HTML_ROWS + 1)])._repr_html_())


def test_an_allocation_in_one_line_and_in_a_table():
    one = tl.allocate(STRUCTURE, [1.0], LIMITS)
    assert repr(one) == f"<Allocation {one}>"
    assert words(one._repr_html_()) == [["cable", "tension (N)"], ["0", "1.5"], ["1", "0.5"]]
    both = tl.allocate(STRUCTURE, [[1.0], [20.0]], LIMITS)
    assert repr(both) == "<Allocation of 2 wrenches: 1 EXACT, 1 NEAREST; largest residual 14.5>"
    assert words(both._repr_html_())[1:] == [
        ["● exact", "1", "50.0 %", "0", "6"],
        ["○ certified infeasible", "1", "50.0 %", "14.5", "7"],
    ]
    assert words(tl.allocate(np.ones((0, 1, 2)), [1.0], LIMITS)._repr_html_())[1:] == []


def test_a_rig_lists_its_modules():
    table = words(four()._repr_html_())
    limits = ["lower (N)", "upper (N)", "brake (N)"]
    assert table[0] == ["module", "anchor (m)", "cable at home (m)", *limits, "N/A", "spool radius (m)"]
    assert table[4][:4] == ["top", "(0, 2.3, 0)", "2.000", "0.5"]
    assert "attachment (m)" in words(tl.load_rig("datasets/rigs/ipanema-2.toml")._repr_html_())[0]


def test_allocations_become_tables_of_pandas_and_xarray():
    rig = four()
    wrenches = np.random.default_rng(0).normal(size=(2, 3, 3))
    found = tl.allocate(rig.structure_matrix(rig.home), wrenches, rig.limits)
    frame = found.to_pandas()
    assert frame.index.names == ["axis_0", "axis_1"]
    assert frame.loc[(1, 2), "tension_3"] == found.tensions[1, 2, 3]
    assert frame.loc[(0, 1), "status"] == tl.Status(found.status[0, 1]).name
    data = found.to_xarray()
    assert data["tensions"].dims == ("axis_0", "axis_1", "cable")
    assert data["tensions"].attrs["units"] == "N"
    np.testing.assert_array_equal(data["wrench"], found.wrench)
    assert len(tl.allocate(STRUCTURE, [1.0], LIMITS).to_pandas()) == 1


def test_without_pandas_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(MissingDependency, match=r"a data frame needs pandas: pip install \"tensionlab\[data\]\""):
        tl.allocate(STRUCTURE, [1.0], LIMITS).to_pandas()


def front():
    """A search that found a layout of four modules, and one of five that is no better."""
    limits = (0.5, 6.0)
    corners = [[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1]]
    modules = tuple(tl.Module(f"wall {i}", np.array(each), *limits) for i, each in enumerate(corners))
    rigs = [tl.Rig(f"room-{count}", "point", modules[:count], np.zeros(3)) for count in (4, 5)]
    layouts = tuple(
        Layout(rig, score, score, (0.25,) * rig.m) for rig, score in zip(rigs, (2.5, 2.0), strict=True)
    )
    return LayoutSearch(Objective(), layouts)


@functools.cache
def recorded():
    """Return a run of four cycles, written to a log and read again."""
    with tempfile.TemporaryDirectory() as folder:
        logged(Path(folder) / "run.mcap", four(), 4, lost=1)
        return read_run(Path(folder) / "run.mcap")


RESULTS = {
    "allocation": lambda: tl.allocate(STRUCTURE, [1.0], LIMITS),
    "allocations": lambda: tl.allocate(STRUCTURE, [[1.0], [20.0]], LIMITS),
    "allocator": lambda: tl.Allocator(tl.TensionLimits([0.0, 1.0], [5.0, 6.0]), "dykstra"),
    "rig": four,
    "module": lambda: four().modules[0],
    "limits": lambda: four().limits,
    "comparison": lambda: compare(four(), solvers=["newton", "least-sum"], directions=np.eye(3)),
    "run": recorded,
    "statistics": lambda: recount(recorded()),
    "grid": lambda: tl.workspace.box((0, 1), (0, 1), step=0.5),
    "poses": lambda: tl.workspace.PoseList(np.eye(3)),
    "layout": lambda: front().best,
    "space": lambda: tl.workspace.Space(tl.workspace.room((4, 2, 3))[2:4], (3, 4)),
    "platform": lambda: tl.Platform(2.0, [0, 0, 0.1], np.eye(3)),
    "search": front,
    "recording": lambda: tl.datasets.load("recordings/ideal-simulated"),
    "benchmark": lambda: tl.datasets.load("benchmarks/results"),
    "problems": lambda: problem_set("point", 10),
    "scenario": lambda: load_scenario("bow"),
}


@pytest.mark.parametrize("name", RESULTS)
def test_every_result_shows_itself_in_one_line_and_in_html(name):
    result = RESULTS[name]()
    assert repr(result).startswith(f"<{type(result).__name__}")
    assert "\n" not in repr(result)
    assert len(repr(result)) < 160
    if hasattr(result, "_repr_html_"):
        html = result._repr_html_()
        assert all(html.count(f"<{tag}") == html.count(f"</{tag}>") for tag in ("table", "tr", "td", "th", "div"))
        assert len({len(row) for row in words(html.partition("</table>")[0])}) == 1
    if hasattr(result, "to_pandas") and name != "benchmark":  # the committed results have no single problems
        assert len(result.to_pandas())


def test_a_run_and_a_search_name_what_failed():
    lines = words(recorded()._repr_html_())
    assert ["deadlines missed", "0"] in lines
    assert [row[-1] for row in lines if row[0] == "floor-2"] == ["lower 75 %, fault ENCODER, lost at 0.040 s"]
    assert ["5", "2", "2", "✗ no"] in words(front()._repr_html_())


def test_completion_offers_public_names_only():
    for module in (tl, tl.workspace, tl.datasets, tl.plots):
        assert dir(module) == sorted({*module.__all__, *({"__version__"} if module is tl else ())})
        assert all(hasattr(module, name) for name in dir(module))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        tl.nonsense  # noqa: B018
