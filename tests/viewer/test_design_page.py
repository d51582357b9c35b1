"""The design page: what it says and saves, and real drags and clicks in real browsers."""

import subprocess
import sys

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import tensionlab as tl
from tensionlab.errors import WriteError
from tensionlab.viewer import state as edits
from tensionlab.viewer.design_panel import legend, own_spaces, save_below, status_html, tensions_html
from tensionlab.viewer.design_scene import draw
from tensionlab.viewer.evaluation import evaluate
from tensionlab.viewer.scene import force_scale
from tensionlab.viewer.state import begin
from tests.helpers.browsers import HANGS_S, VISER, Tab, needs_browser, plain, served, until

SPACES = tl.datasets.folder() / "spaces"
# Complaint of the browser about how viser listens to the mouse.
VISERS_OWN = "Unable to preventDefault inside passive event listener"


def changed(page, before):
    """Wait until the rig is another one than before."""
    until(lambda: page.state.rig is not before, "the change")


def saved(tab, name):
    """The anchors of a rig that the page saves in a file."""
    tab.click_tab("File")
    tab.enter("file", str(name))
    tab.press("Save")
    until(name.exists, "the file")
    return tl.load_rig(name).anchors


def test_files_that_are_spaces_can_be_chosen(tmp_path):
    (tmp_path / "my-room.toml").write_text((SPACES / "four-in-a-room.toml").read_text())
    (tmp_path / "rig.toml").write_text((SPACES.parent / "rigs" / "cube-8.toml").read_text())
    (tmp_path / "broken.toml").write_text("[[counts")
    assert own_spaces(tmp_path) == ["my-room.toml"]


def test_the_legend_has_what_is_drawn(point):
    assert [text for text, _ in legend(point, evaluate(point))] == ["available forces"]
    state = edits.set_fields(show_workspace=True)(edits.set_wrench(point, [20.0, 0.0, 0.0]))
    assert [text for text, _ in legend(state, evaluate(state))] == [
        "desired force", "rendered force", "error", "proof that it is infeasible", "available forces", "workspace",
    ]  # fmt: skip


def test_the_status_of_feasible_and_infeasible_forces(point):
    state = edits.set_wrench(point, [1.0, 0.5, 1.0])
    text = plain(status_html(state, evaluate(state)))
    assert text.startswith("EXACT the desired force is rendered desired force 1.5 N (1, 0.5, 1)")
    assert "capacity margin 3.68 N at the hand" in text
    state = edits.set_fields(policy="direction")(edits.set_wrench(point, [20.0, 0.0, 0.0]))
    text = plain(status_html(state, evaluate(state)))
    assert text.startswith("NEAREST certified infeasible: the longest wrench in the desired direction is rendered")
    assert "24.4 % of it" in text
    assert "error 15.1 N" in text
    assert "at most 4.88 N along" in text
    state = edits.set_wrench(begin(tl.load_rig("ipanema-2")), [0.0, 0.0, 0.0, 3.0, 0.0, 0.0])
    assert "desired torque 3 N·m (3, 0, 0)" in plain(status_html(state, evaluate(state)))
    state = edits.set_fields(solver="polygon")(begin(tl.load_rig("seven-modules")))
    assert plain(status_html(state, evaluate(state))).startswith("no answer")


def test_bars_name_the_limit_that_is_reached_and_names_of_modules_are_text(point):
    state = edits.set_wrench(edits.rename(point, "top", "<b>top</b>"), [1.0, 0.5, 1.0])
    html = tensions_html(state, evaluate(state))
    assert "floor-3 0.50 N lower limit" in plain(html)
    assert "&lt;b&gt;top" in html


def test_a_saved_rig_is_the_same_and_one_that_cannot_work_is_not_saved(point, tmp_path):
    moved = edits.move_anchor(point, "floor-1", [0.7, 0.0, 0.1])
    save_below(tmp_path, moved.rig, "mine.toml")
    assert tl.load_rig(tmp_path / "mine.toml") == moved.rig
    below = edits.move_anchor(point, "top", [0.0, -0.5, 0.0])
    with pytest.raises(tl.errors.RigError, match=r"so it is not saved\. balance: no tensions hold"):
        save_below(tmp_path, below.rig, "other.toml")
    for path in ("", "rig.txt", "rig"):
        with pytest.raises(WriteError, match=r"must end in \.toml"):
            save_below(tmp_path, point.rig, path)
    assert [file.name for file in tmp_path.iterdir()] == ["mine.toml"]


@pytest.mark.parametrize("path", ["../mine.toml", "/mine.toml", "link/mine.toml", "a/../../mine.toml", "a\0.toml"])
def test_a_file_elsewhere_is_refused(point, path, tmp_path):
    here = tmp_path / "here"
    here.mkdir()
    (here / "link").symlink_to(tmp_path)
    with pytest.raises(WriteError, match=r"uses files below it only|is no path"):
        save_below(here, point.rig, path)
    assert [file.name for file in tmp_path.iterdir()] == ["here"]


@pytest.mark.slow
@needs_browser
@pytest.mark.realtime  # a real browser, which on a busy machine complains of what has gone meanwhile
def test_a_rig_is_designed_with_the_mouse(tmp_path, monkeypatch, browser):
    monkeypatch.chdir(tmp_path)
    with served() as page:
        tab = Tab(browser, page)

        # An anchor is dragged twice, saved, and put back step by step.
        anchor = page.state.anchors[0]
        for goal in np.add(anchor, [[0.15, 0.0, 0.25], [0.2, 0.1, -0.1]]):
            before = page.state.rig
            tab.drag(page.state.anchors[0], goal)
            changed(page, before)
            tab.settle()
            moved = page.state.anchors[0]
            assert tab.pixel(moved) == pytest.approx(tab.pixel(goal), abs=4.0)  # under the mouse
        assert saved(tab, tmp_path / "dragged.toml")[0] == pytest.approx(moved)
        for _ in range(2):
            before = page.state.rig
            tab.press("Undo")
            changed(page, before)
        assert page.state.anchors[0].tolist() == anchor.tolist()

        # The arrow of the desired force follows its ball, out of the available forces and back in.
        far, near = (np.add(page.state.position, [0.0, up, 0.0]) for up in (0.45, 0.1))
        for goal, word in ((far, "NEAREST"), (near, "EXACT")):
            tab.drag(draw(page.state, evaluate(page.state)).tip, goal)
            tab.wait_for(word)
            tab.settle()
            end = page.state.position + force_scale(page.state.rig) * page.state.wrench
            assert tab.pixel(end) == pytest.approx(tab.pixel(goal), abs=4.0)

        # Two more solvers have a row each, and a line in the charts.
        tab.click_tab("Solvers")
        tab.open_folder("compare with")
        for solver in ("minimax", "dykstra"):
            tab.check(solver)
        for solver in ("newton", "minimax", "dykstra"):
            tab.tab.get_by_role("cell", name=f"■ {solver}", exact=True).wait_for()
        tab.wait_for("error N")

        # Nothing came from elsewhere meanwhile.
        own = page.server.url.partition("?")[0], "blob:", "data:"
        assert tab.requests
        assert [url for url in tab.requests if not url.startswith(own)] == []
        assert [error for error in tab.errors if VISERS_OWN not in error] == []


@pytest.mark.slow
@needs_browser
def test_browsers_with_the_token_show_one_state_and_one_that_is_closed_harms_nothing(browser):
    with served(host="0.0.0.0") as page:
        port, token = page.server.viser.get_port(), page.server.url.partition("=")[2]
        assert len(token) > 16
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://127.0.0.1:{port}/", subprotocols=[VISER])  # without it
        page.server.url = f"http://localhost:{port}/?token={token}"
        one, other = Tab(browser, page), Tab(browser, page)
        one.drag(page.state.position, np.add(page.state.position, [0.0, 2.6, 0.0]))
        for tab in (one, other):
            tab.wait_for("NEAREST")  # the hand is out of reach
        one.tab.close()
        until(lambda: len(page.server.viser.get_clients()) == 1, "the end of a browser")
        other.press("Undo")
        other.wait_for("EXACT")
        assert page.state.position.tolist() == page.state.rig.home.tolist()


def test_ctrl_c_ends_the_command_with_one_line():
    import signal

    words = [sys.executable, "-m", "tensionlab", "view", "bartels2026-validation", "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        try:
            line = running.stdout.readline()
            assert line.startswith("http://127.0.0.1:"), running.stderr.read()
            running.send_signal(signal.SIGINT)
            out, err = running.communicate(timeout=HANGS_S)
        finally:
            running.kill()
    kept = "what was saved from the page is kept; the same command shows the file's rig again"
    assert (running.returncode, out, err) == (130, "", f"tensionlab: interrupted: {kept}\n")
