"""The page of a run in real browsers, with the run and its modules in processes of their own."""

import os
import re
import signal
import urllib.error
import urllib.request
import uuid
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks.processes import process, simulated
from tensionlab.hardware.client.links import modules_to_toml
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.protocol.codes import State
from tensionlab.hardware.sharing import find_runs
from tests.helpers.browsers import BROWSER, HANGS_S, OPTIONS, needs_browser, until
from tests.helpers.page_client import attacked, joined

RIG = "bartels2026-validation"
# Whether the page has the heading NO NEWS with an opacity.
NO_NEWS = """opacity => [...document.querySelectorAll("b")].some(
    b => b.textContent === "NO NEWS" && getComputedStyle(b.parentElement.parentElement).opacity === opacity
)"""
pytestmark = [needs_browser, pytest.mark.slow, pytest.mark.realtime]  # real processes and a real browser


@contextmanager
def running(tmp_path, *words):
    """A run with --view on modules of another process: its process, the address of its page, and the links."""
    with simulated(RIG) as (links, _):
        file = tmp_path / "modules.toml"
        file.write_text(modules_to_toml(links))
        # Set-points live long, so that a busy machine loses no module.
        call = ("run", RIG, "--modules", file, "--force", "1 2 0.5", "--ttl", "2", "--view", *words)
        with process(*call) as run:
            url, shown, _ = run.stderr.readline().partition(" shows the run")
            assert shown, url + run.stderr.read()
            yield run, url, links


@contextmanager
def watched(run):
    """A watcher of a run, as another process has it."""

    def found():
        others = {each.info.pid: each for each in find_runs()}
        watcher = others.pop(run.pid, None)
        for each in others.values():
            each.close()
        return watcher

    watcher = until(found, "the run")
    try:
        yield watcher
    finally:
        watcher.close()


def wait_for_cycles(watcher, cycles):
    """Wait until a run has done a number of further cycles; return its report then."""

    def report(least):
        watcher.poll()
        return watcher.report if watcher.report is not None and watcher.report.cycles >= least else None

    begin = until(lambda: report(1), "a cycle").cycles
    return until(lambda: report(begin + cycles), "more cycles")


def opened(browser, url):
    tab = browser.new_page(viewport={"width": 960, "height": 600})
    tab.set_default_timeout(1000.0 * HANGS_S)
    tab.goto(url)
    tab.get_by_text("LIVE", exact=True).wait_for()
    return tab


def ask(links):
    """States that modules report."""
    found = []
    for name, url in links.items():
        with ModuleClient(name, url) as client:
            found.append(client.hello().state)
    return found


@pytest.fixture(autouse=True)
def quiet(monkeypatch, tmp_path):
    """No browser but those of the test."""
    monkeypatch.setenv("BROWSER", "true")
    monkeypatch.setenv("HOME", str(tmp_path))


def test_the_stop_button_stops_modules_of_another_process_and_says_how_the_run_ended(tmp_path, browser):
    with running(tmp_path) as (run, url, links):
        tab = opened(browser, url)
        tab.get_by_role("button", name="STOP ALL MODULES").click()
        tab.get_by_text("STOPPED", exact=True).wait_for()
        tab.get_by_text("confirmed by 4 modules").wait_for()
        assert ask(links) == [State.ESTOP] * 4
        tab.get_by_text("ENDED", exact=True).wait_for()
        tab.get_by_text("emergency stop (from another terminal)").wait_for()
        assert run.wait(HANGS_S) == 1


def test_the_stop_button_works_without_viser_and_whatever_another_client_of_the_page_sends(tmp_path, browser):
    with running(tmp_path) as (run, url, links):
        tab = opened(browser, url)
        with attacked(url) as sent:
            until(lambda: len(sent) > 1000, "the attack")
            tab.evaluate("document.getElementById('root').remove()")  # all that viser draws
            tab.get_by_role("button", name="STOP ALL MODULES").click()
            assert run.wait(HANGS_S) == 1
            assert ask(links) == [State.ESTOP] * 4


def test_the_stop_has_a_route_of_its_own_that_needs_the_token_alone(tmp_path):
    with running(tmp_path) as (run, url, links), attacked(url):
        stop = url.replace("/?", "/stop?")
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(stop.partition("?")[0], timeout=HANGS_S)
        with watched(run) as watcher:
            wait_for_cycles(watcher, 1)
        with urllib.request.urlopen(stop, timeout=HANGS_S) as answer:
            assert answer.read().decode() == "STOPPED\nconfirmed by 4 modules\n"
        assert ask(links) == [State.ESTOP] * 4


def test_a_run_that_hangs_is_shown_as_stale_and_a_stop_that_fails_says_so(tmp_path, browser):
    with running(tmp_path) as (run, url, _):
        tab = opened(browser, url)
        os.kill(run.pid, signal.SIGSTOP)
        try:
            tab.get_by_text(re.compile("^STALE for")).wait_for()
            tab.get_by_role("button", name="STOP ALL MODULES").click()
            tab.get_by_text("NOT STOPPED", exact=True).wait_for()
            said = tab.get_by_text(f"kill -9 {run.pid}").first.inner_text()
            assert f"floor-1: process {run.pid}" in said
        finally:
            os.kill(run.pid, signal.SIGCONT)
        run.kill()
        tab.get_by_text("GONE", exact=True).wait_for()


def processes_with(mark, parent=None):
    """Processes that were called with a word, by any process or by one."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().decode().split("\0")
            caller = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        if mark in words and parent in (None, caller):
            found.append(int(folder.name))
    return found


def test_a_browser_that_hangs_or_is_closed_changes_nothing_in_the_run(tmp_path, browser):
    mark = f"--test-{uuid.uuid4()}"
    with running(tmp_path, "--rate", "20") as (run, url, links):
        opened(browser.browser_type.launch(executable_path=BROWSER, args=[*OPTIONS, mark]), url)
        group = {os.getpgid(pid) for pid in processes_with(mark)}
        assert len(group) == 1
        with watched(run) as watcher:
            os.killpg(*group, signal.SIGSTOP)
            wait_for_cycles(watcher, 60)
            os.killpg(*group, signal.SIGKILL)
            report = wait_for_cycles(watcher, 20)
            assert (report.lost, watcher.condition) == ({}, "live")
            with joined(url) as client:
                assert client.elements()  # others get the page
            run.send_signal(signal.SIGINT)
            assert run.wait(HANGS_S) == 130  # by Ctrl-C
        assert ask(links) == [State.IDLE] * 4


def test_a_page_that_hears_nothing_from_its_server_says_so_and_the_run_gets_another_page(tmp_path, browser):
    with running(tmp_path) as (run, url, _):
        tab = opened(browser, url)
        tab.wait_for_function(NO_NEWS, arg="0")  # it is there, and not seen
        [server] = processes_with("tensionlab.viewer.live", run.pid)
        os.kill(server, signal.SIGKILL)
        tab.wait_for_function(NO_NEWS, arg="1")
        tab.close()
        with watched(run) as watcher:
            assert wait_for_cycles(watcher, 20).lost == {}  # the run has not noticed
        with process("view", RIG, "--live", "--no-browser") as view:
            other, shown, rest = view.stdout.readline().partition(" shows the run of ")
            assert (shown, rest) == (" shows the run of ", f"{RIG}; Ctrl-C ends it\n"), view.stderr.read()
            opened(browser, other)
            view.send_signal(signal.SIGINT)
            assert view.wait(HANGS_S) == 130
            assert "the run continues" in view.stderr.read()
