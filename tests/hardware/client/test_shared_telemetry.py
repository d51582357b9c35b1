"""One process has the modules, others see what they report."""

import json
import os
import socket

import pytest

from tensionlab.hardware.client import shared_telemetry
from tensionlab.hardware.client.locks import LinkLock, holder
from tensionlab.hardware.client.shared_telemetry import Publisher, Watcher


@pytest.fixture
def published(monkeypatch):
    """Return a publisher that answers without a pause."""
    monkeypatch.setattr(shared_telemetry, "MIN_PERIOD_S", 0.0)
    return Publisher()


@pytest.fixture
def watcher(published):
    """Return a watcher that waits for answers."""
    made = Watcher(published.port, published.token)
    made._socket.settimeout(60.0)
    yield made
    made.close()


def test_who_knows_the_token_is_told_of_the_topic_that_it_asks_for_and_hears_its_last_word(
    published, watcher, caplog
):
    def fails():
        raise KeyError("a state that has no name")

    published.topics |= {"broken": fails, "run": lambda: b"goes on"}
    stranger = Watcher(published.port, "x" + published.token[1:])
    for topic in ("another", "broken"):
        watcher.ask(topic)
    for _ in range(2):  # it is remembered by the time of the second answer
        stranger.ask("run")
        watcher.ask("run")
        assert next(watcher.answers()) == b"goes on"
    assert list(stranger.answers()) == [], "it was answered before the watcher, if at all"
    assert "an answer about broken" in caplog.text
    published.topics["run"] = lambda: b"over"
    published.announce("run")
    assert next(watcher.answers()) == b"over"
    stranger.close()


def test_what_a_watcher_sends_or_leaves_unread_changes_nothing(published, watcher):
    published.topics["run"] = lambda: 1000 * b"x"
    lazy, gone = Watcher(published.port, published.token), Watcher(published.port, published.token)
    for _ in range(50):
        lazy.ask("run")
    rubbish = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for content in (b"", b"x", published.token.encode() + b"x", 60_000 * b"x"):
        rubbish.sendto(content, ("127.0.0.1", published.port))
    gone.ask("run")
    gone.close()
    watcher.ask("run")
    assert next(watcher.answers()) == 1000 * b"x"
    for each in (lazy, rubbish):
        each.close()


def test_the_note_of_a_lock_leads_to_the_telemetry_and_is_nobody_elses(locks_folder):
    lock = LinkLock("COM5")
    who = holder("COM5")
    assert (who.port, who.token) == (shared_telemetry.publisher().port, shared_telemetry.publisher().token)
    assert who.token not in str(who)
    assert locks_folder.stat().st_mode & 0o077 == 0
    lock.release()


def test_the_system_may_have_no_port(monkeypatch, locks_folder):
    def refused(*words):
        raise OSError("none")

    monkeypatch.setattr(shared_telemetry, "_publisher", None)
    monkeypatch.setattr(shared_telemetry.socket, "socket", refused)
    lock = LinkLock("COM5")
    assert holder("COM5").port is None
    assert json.loads(next(locks_folder.glob("*.json")).read_text())["pid"] == os.getpid()
    lock.release()
