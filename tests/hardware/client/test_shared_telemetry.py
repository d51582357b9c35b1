"""One process has the modules, others see what they report."""

import json
import os
import socket
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.hardware.client import shared_telemetry
from tensionlab.hardware.client.locks import LinkLock, holder
from tensionlab.hardware.client.module import ModuleClient
from tensionlab.hardware.client.shared_telemetry import Publisher, Report, Watcher
from tensionlab.hardware.protocol.codes import BrakeState, Fault, Limit, State
from tensionlab.hardware.protocol.messages import ConfigureTelemetry, Telemetry
from tensionlab.hardware.simulation.links import SimulatedLink
from tensionlab.hardware.simulation.world import World

SAID = Telemetry(
    123456, State.RUNNING, Fault(0), Limit.SLEW, 17, 2.5, 0.75, 1.25, -0.5, 12.0, 0.25, BrakeState.OPEN, 3, 4, 250
)


@pytest.fixture
def published(monkeypatch):
    """Return a publisher that answers without a pause."""
    monkeypatch.setattr(shared_telemetry, "MIN_PERIOD_S", 0.0)
    return Publisher()


def heard(watcher, count):
    """Return so many reports, whenever they come."""
    watcher._socket.settimeout(60.0)
    reports = watcher.reports()
    return [next(reports) for _ in range(count)]


@pytest.mark.parametrize("telemetry", [SAID, replace(SAID, supply=np.nan, length=np.inf), None])
@pytest.mark.parametrize("name", ["floor-1", "a/b c", "ü→😀", 100 * "😀"])
def test_a_report_is_read_as_it_was_written(telemetry, name):
    age = np.inf if telemetry is None else 0.25
    report = Report("socket://127.0.0.1:4001", name, telemetry, age, 2)
    assert len(report.pack()) <= shared_telemetry.MAX_REPLY_BYTES
    assert repr(Report.unpack(report.pack())) == repr(report), "NaN is itself"


def test_who_knows_the_token_is_told_of_all_modules_and_only_if_it_asks(published, caplog):
    def fails():
        raise KeyError("a state that has no name")

    published.topics["module COM9"] = fails
    for index in range(3):
        published.topics[f"module COM{index}"] = Report(f"COM{index}", "left", SAID, 0.1 * index, 0).pack
    watcher = Watcher(published.port, published.token)
    stranger = Watcher(published.port, "x" + published.token[1:])
    assert list(watcher.reports()) == []
    for _ in range(2):
        stranger.ask()
        watcher.ask()
        assert [(each.url, each.telemetry, each.age) for each in heard(watcher, 3)] == [
            (f"COM{index}", SAID, 0.1 * index) for index in range(3)
        ]
    assert list(stranger.reports()) == [], "it was answered before the watcher, if at all"
    assert "an answer about module COM9" in caplog.text
    watcher.close()
    stranger.close()


def test_who_asks_for_a_topic_is_told_of_it_alone_and_hears_its_last_word(published):
    published.topics["module COM1"] = Report("COM1", "left", SAID, 0.0, 0).pack
    published.topics["run"] = lambda: b"goes on"
    watcher = Watcher(published.port, published.token)
    watcher._socket.settimeout(60.0)
    watcher.ask("another")
    for _ in range(2):  # it is remembered by the time of the second answer
        watcher.ask("run")
        assert next(watcher.answers()) == b"goes on"
    published.topics["run"] = lambda: b"over"
    published.announce("run")
    assert next(watcher.answers()) == b"over"
    watcher.close()


def test_what_a_watcher_sends_or_leaves_unread_changes_nothing_and_what_is_no_report_is_left_out(published):
    answers = [b"", b"{}", b'{"url": "COM1"}', b"\xff", b"null", Report("COM1", "left", SAID, 0.0, 0).pack()]
    published.topics |= {f"module {number}": lambda answer=answer: answer for number, answer in enumerate(answers)}
    lazy = Watcher(published.port, published.token)
    for _ in range(50):
        lazy.ask()
    rubbish = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for content in (b"", b"x", published.token.encode() + b"x", 60_000 * b"x"):
        rubbish.sendto(content, ("127.0.0.1", published.port))
    gone = Watcher(published.port, published.token)
    gone.ask()
    gone.close()
    watcher = Watcher(published.port, published.token)
    watcher.ask()
    assert heard(watcher, 1)[0].url == "COM1"
    for each in (lazy, rubbish, watcher):
        each.close()


def test_the_note_of_a_lock_leads_to_the_telemetry_and_is_nobody_elses(locks_folder):
    lock = LinkLock("COM5")
    who = holder("COM5")
    assert (who.port, who.token) == (shared_telemetry.publisher().port, shared_telemetry.publisher().token)
    assert who.token not in str(who)
    assert locks_folder.stat().st_mode & 0o077 == 0
    lock.release()


class ReadLink(SimulatedLink):
    """Link that a client reads in a thread of its own, as real ones are."""

    lockstep, file = False, None

    def __init__(self, module, url):
        super().__init__(module, url)
        self._turn = threading.Lock()

    def receive(self, timeout):
        with self._turn:
            return super().receive(min(timeout, 0.02))

    def send(self, content):
        with self._turn:
            super().send(content)


def test_a_client_is_published_while_it_is_open_whatever_its_name():
    world = World(tl.load_rig("floor-3"))
    client = ModuleClient("a/b → c", ReadLink(world.modules[0], "COM77"))
    published = shared_telemetry.publisher()
    assert Report.unpack(published.topics["module COM77"]()) == Report("COM77", "a/b → c", None, np.inf, 0)
    client.command(ConfigureTelemetry(20))
    while client.telemetry is None:
        time.sleep(1e-3)
    told = Report.unpack(published.topics["module COM77"]())
    assert told.telemetry.length == pytest.approx(world.modules[0].sample.length, abs=1e-3)
    assert told.age >= 0.0
    client.close()
    assert "module COM77" not in published.topics


def test_the_system_may_have_no_port(monkeypatch, locks_folder):
    def refused(*words):
        raise OSError("none")

    monkeypatch.setattr(shared_telemetry, "_publisher", None)
    monkeypatch.setattr(shared_telemetry.socket, "socket", refused)
    lock = LinkLock("COM5")
    assert holder("COM5").port is None
    assert json.loads(next(locks_folder.glob("*.json")).read_text())["pid"] == os.getpid()
    lock.release()
