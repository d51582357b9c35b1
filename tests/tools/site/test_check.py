"""The check of the site sees what is wrong with one: in a real browser, a small site with every mistake."""

import pytest

from tools.site.browser import browser, installed
from tools.site.check import Findings, check_pages, check_search, serve

HEAD = (
    '<!doctype html><html lang="en"><meta name="viewport" content="width=device-width">'
    '<title>t</title><link rel="icon" href="data:,"><main>'
)
DOT = "data:image/svg+xml,<svg xmlns='http://www.w3.org/2000/svg' width='1' height='1'/>"
GOOD = f'{HEAD}<a href="bad.html#there">b</a><img src="{DOT}" alt="a dot"><math alttext="x"><mi>x</mi></math>'
BAD = f"""{HEAD}<p id="there">text</p><a href="none.html">a</a><a href="good.html#none">b</a><img src="{DOT}">
<img src="none.png" alt="nothing"><div style="width: 700px">wide</div><script>throw new Error("a fault")</script>
<script src="http://127.0.0.1:9/elsewhere.js"></script><div style="height: 3000px"></div>
<article><pre style="width: 40px; overflow: auto">a long line of code</pre></article>"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(installed() is None, reason="no Chromium here"),
]


@pytest.fixture(scope="module")
def page():
    with browser() as opened:
        yield opened


def checked(opened, folder, **pages):
    for name, text in pages.items():
        (folder / f"{name}.html").write_text(text, encoding="utf-8")
    with serve(folder) as base:
        return check_pages(*opened, folder, base)


def test_a_site_that_is_right_is_counted(tmp_path, page):
    found = checked(page, tmp_path, good=GOOD, bad=f'{HEAD}<p id="there">text</p>')
    assert found.wrong == []
    assert (found.pages, found.links, found.pictures, found.equations) == (2, {"bad.html#there"}, 1, 1)
    assert found.elsewhere == set()


def test_every_mistake_is_named(tmp_path, page):
    found = checked(page, tmp_path, good=GOOD, bad=BAD)
    text = "\n".join(found.wrong)
    for words in (
        "bad.html: no page none.html",
        "bad.html: no anchor #none in good.html",
        "bad.html: picture does not load",
        "bad.html: picture without words: data:",
        "px wider than a phone: <div",
        "bad.html: says: a fault",
        "bad.html: code is cut off: a long line of code",
        "px long without a list of its sections",
    ):
        assert words in text, text
    assert "good.html:" not in text
    assert found.elsewhere == {"http://127.0.0.1:9/elsewhere.js"}


def test_a_search_is_typed_and_its_results_are_read(tmp_path, page):
    ctrl_k = 'onkeydown = (e) => { if (e.ctrlKey && e.key == "k") document.querySelector("input").focus() }'
    (tmp_path / "index.html").write_text(
        f'{HEAD}<form action="search.html"><input name="q"></form><script>{ctrl_k}</script>', encoding="utf-8"
    )
    (tmp_path / "search.html").write_text(
        f'{HEAD}<div id="search-results"><h2>Search Results</h2><li><a>Glossary</a></li></div>', encoding="utf-8"
    )
    with serve(tmp_path) as base:
        found = Findings()
        check_search(page[0], f"{base}index.html", found)
    assert found.searches == 3
    assert len(found.wrong) == 2
    assert "'capacity_margin' is not among ['Glossary']" in found.wrong[0]
