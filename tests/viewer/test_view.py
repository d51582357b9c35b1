"""`tl.view`: the design page of a rig in this process."""

import subprocess
import sys
import urllib.error
import urllib.request
from types import SimpleNamespace

import pytest

import tensionlab as tl
from tensionlab.viewer import state as edits
from tensionlab.viewer.server import PageServer
from tests.helpers.browsers import HANGS_S, chromium, needs_browser, until

RIG = "bartels2026-validation"


@pytest.fixture
def opened(monkeypatch):
    """Addresses at which a browser was opened."""
    urls = []
    monkeypatch.setattr(PageServer, "open_browser", lambda server: urls.append(server.url))
    return urls


def test_outside_a_notebook_a_browser_opens_and_the_rig_is_as_it_is_designed(opened, monkeypatch):
    monkeypatch.setitem(sys.modules, "IPython", None)
    rig = tl.load_rig(RIG)
    page = tl.view(rig)
    try:
        assert opened == [page.url]
        assert page.rig == rig
        assert repr(page) == f"<DesignPage of {RIG} at {page.url}>"
        with urllib.request.urlopen(page.url, timeout=HANGS_S) as answer:
            assert answer.status == 200
            assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(page.url.partition("?")[0], timeout=HANGS_S)  # without the token
        page.edit(lambda state: edits.move_anchor(state, "floor-1", [1.0, 0.0, 0.0]))
        until(lambda: page.rig.modules[0].anchor.tolist() == [1.0, 0.0, 0.0], "the edit")
    finally:
        page.close()
    assert page.rig.modules[0].anchor.tolist() == [1.0, 0.0, 0.0]
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(page.url, timeout=HANGS_S)


@pytest.mark.slow
@needs_browser
def test_a_page_of_another_origin_shows_it_in_a_frame_and_it_works_there(opened, monkeypatch):
    shell = SimpleNamespace(kernel=object())
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    page = tl.view(tl.load_rig(RIG))
    assert opened == []
    try:
        with chromium() as browser:
            tab = browser.new_page()
            tab.set_default_timeout(1000.0 * HANGS_S)
            tab.set_content(page._repr_html_())
            tab.frame_locator("iframe").get_by_text("capacity margin", exact=True).wait_for()
            tab.set_content(f'<a href="{page.url}">the page</a>')  # as a terminal in a browser has it
            tab.get_by_text("the page").click()
            tab.get_by_text("capacity margin", exact=True).wait_for()
    finally:
        page.close()


def test_neither_importing_the_package_nor_a_first_solve_loads_what_serves_pages():
    script = (
        f"import sys, tensionlab as tl; rig = tl.load_rig('{RIG}'); "
        "tl.allocate(rig.structure_matrix(rig.home), [0, 0, 1], rig.limits); "
        "print([name for name in ('viser', 'tensionlab.viewer', 'websockets') if name in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
