"""One thread reads all links: each by itself, whatever becomes of the others."""

import os
import socket
import threading
import time
from contextlib import ExitStack

import pytest

from tensionlab.hardware.client.links import REMOVAL_TIMEOUT_S, SocketLink, link_reader
from tensionlab.hardware.client.module import ModuleClient

LONG_S = 30.0


class Read:
    """Socket that is read into `content`; each `send` waits until it has been."""

    def __init__(self, outcome=True, number=None):
        self.near, self.far = socket.socketpair()
        self.number = self.near.fileno() if number is None else os.dup2(self.near.fileno(), number)
        self.content, self.outcome, self._said = [], outcome, threading.Event()
        link_reader().add(self.number, self.read)

    def read(self):
        self.content.append(os.read(self.number, 100))
        self._said.set()
        if isinstance(self.outcome, Exception):
            raise self.outcome
        return self.outcome

    def send(self, content):
        self._said.clear()
        self.far.send(content)
        assert self._said.wait(LONG_S)

    def close(self):
        link_reader().remove(self.number, self.read)
        self.near.close()
        self.far.close()


@pytest.fixture
def other():
    found = Read()
    yield found
    found.close()


@pytest.mark.parametrize("outcome", [False, ValueError("of a caller")], ids=["ends", "fails"])
def test_a_link_that_ends_or_whose_caller_fails_is_read_no_more_and_the_others_are(other, outcome, monkeypatch):
    told = []
    monkeypatch.setattr(threading, "excepthook", lambda args: told.append(args.exc_value))
    one = Read(outcome)
    one.send(b"last")
    other.send(b"a")
    one.far.send(b"more")
    other.send(b"b")
    one.close()
    assert one.content == [b"last"]
    assert other.content == [b"a", b"b"]
    assert told == [outcome] * (outcome is not False)


def test_what_is_removed_is_read_no_more(other):
    one = Read()
    one.send(b"a")
    link_reader().remove(one.number, one.read)
    one.far.send(b"b")
    other.send(b"c")
    assert one.content == [b"a"]
    one.close()


def test_a_link_may_be_removed_while_it_is_read():
    one, took = Read(), []

    def read():
        began = time.perf_counter()
        link_reader().remove(one.number, read)
        took.append(time.perf_counter() - began)
        return Read.read(one)

    link_reader().add(one.number, read)
    one.send(b"a")
    one.close()
    assert took[0] < 0.5 * REMOVAL_TIMEOUT_S


def test_a_number_that_was_closed_without_a_word_is_read_for_the_next_link():
    one = Read()
    second = Read(number=one.number)
    link_reader().remove(one.number, one.read)  # too late: it is not its own any more
    second.send(b"a")
    assert second.content == [b"a"]
    assert one.content == []
    second.close()
    one.close()


def test_a_link_that_is_closed_before_it_is_waited_for_is_read_once_to_learn_why(other):
    near, far = socket.socketpair()
    closed, learned = near.fileno(), threading.Event()
    near.close()
    far.close()
    link_reader().add(closed, learned.set)
    assert learned.wait(LONG_S)
    other.send(b"a")
    assert other.content == [b"a"]


def test_the_modules_of_a_process_have_one_thread():
    link_reader()
    with ExitStack() as stack:
        before = {thread.name for thread in threading.enumerate()}
        for name in "abc":
            near, far = socket.socketpair()
            stack.callback(far.close)
            stack.enter_context(ModuleClient(name, SocketLink(f"pair:{name}", near)))
        new = {thread.name for thread in threading.enumerate()} - before
        assert new <= {"telemetry for watchers"}
