"""Watchdog and signals of a run, tick by tick; `test_hung.py` has runs that really hang."""

import signal
import threading
from contextlib import nullcontext
from functools import partial

import pytest

from tensionlab.errors import HardwareError
from tensionlab.hardware.runner.watchdog import (
    GRACE_S,
    NATIVE_GRACE_S,
    STOPPING_SIGNALS,
    TICK_S,
    Hung,
    Interrupted,
    Interrupts,
    Watchdog,
    stopping,
)
from tensionlab.support.operating_system import ESTOP_SIGNAL


class Ticks:
    """Event whose waiting is a tick: `at` has what happens before some of them; it is set after the last."""

    def __init__(self, count, at=None):
        self.left, self.at, self.number = count, at or {}, 0

    def wait(self, seconds):
        assert seconds == TICK_S
        self.at.get(self.number, lambda: None)()
        self.number += 1
        self.left -= 1
        return self.left < 0

    def set(self):
        self.left = 0


class Kicks(list):
    """Native watchdog that notes how long it has to wait."""

    def kick(self, seconds):
        self.append(round(seconds, 9))

    def close(self):
        self.append("closed")


def watched(ticks, happens=None, first=("cycle 1", 0.1)):
    """Return what becomes of a run after some ticks, in which a few things happen, and the native kicks."""
    said = []
    dog = Watchdog(
        lambda why: said.append(("interrupt", dog._closed.number, why)),
        lambda why: said.append(("end", dog._closed.number, why)),
    )
    begun = {at: partial(dog.begin, *step) if step else dog.rest for at, step in (happens or {}).items()}
    dog._closed, dog._native, dog._watched = Ticks(ticks, begun), Kicks(), threading.get_ident()
    if first:
        dog.begin(*first)
    dog._watch()
    return said, dog._native


GRACE_TICKS = round(GRACE_S / TICK_S)


@pytest.mark.parametrize(
    ("quiet", "steps", "name"),
    [
        (6, {}, "cycle 1"),  # seen in the first tick, and counted in five
        (16, {5: ("cycle 2", 0.1), 10: ("cycle 2", 0.1)}, "cycle 2"),  # each has its own time
    ],
)
def test_a_step_may_take_its_time_and_not_a_tick_more(quiet, steps, name):
    assert watched(quiet, steps)[0] == []
    [(what, tick, why)], _ = watched(quiet + 1, steps)
    assert (what, tick) == ("interrupt", quiet + 1)
    assert why.startswith(f"{name} has not ended for 0.1 s, in ")
    assert why.endswith("): all modules are stopped")
    assert "(watchdog.py:" in why, "where this thread is"


def test_between_steps_nothing_is_late():
    assert watched(500, {3: None})[0] == watched(500, first=None)[0] == []


def test_what_does_not_leave_after_an_interruption_is_ended_once_and_for_the_same_reason():
    assert len(watched(7 + GRACE_TICKS - 1)[0]) == 1
    said, kicks = watched(10_000)
    assert [(what, tick) for what, tick, _ in said] == [("interrupt", 7), ("end", 7 + GRACE_TICKS)]
    assert said[0][2] == said[1][2]
    assert kicks[-1] == 30.0, "time to stop the modules and close the log"


def test_the_native_one_waits_longer_than_this_one_at_each_tick():
    _, kicks = watched(4, {2: ("start", 5.0), 3: None})
    assert kicks == [0.1 + NATIVE_GRACE_S] * 2 + [5.0 + NATIVE_GRACE_S, NATIVE_GRACE_S]
    _, kicks = watched(10_000)
    assert kicks[7:-1] == [GRACE_S + NATIVE_GRACE_S] * GRACE_TICKS


def test_its_threads_end_with_the_context():
    dog, before = Watchdog(lambda why: None, lambda why: None), threading.active_count()
    with dog.watching():
        assert threading.active_count() == before + 1
        (thread,) = (each for each in threading.enumerate() if each.name == "watchdog")
        assert thread.daemon, "it keeps no process from ending"
        native, dog._native = dog._native, Kicks()
    native.close()
    assert not thread.is_alive()
    assert dog._native[-1] == "closed"


# Signals


@pytest.mark.parametrize("number", STOPPING_SIGNALS)
def test_the_first_signal_interrupts_those_after_it_do_not_and_handlers_are_put_back(number):
    before = signal.getsignal(number)
    interrupts = Interrupts()
    with interrupts.caught((number,)):
        with pytest.raises(Interrupted, match=signal.Signals(number).name) as caught:
            signal.raise_signal(number)
        signal.raise_signal(number)
        signal.raise_signal(number)
    assert caught.value.number == number
    assert isinstance(caught.value, KeyboardInterrupt)
    assert signal.getsignal(number) is before


def test_an_orderly_end_is_not_interrupted():
    interrupts = Interrupts()
    with interrupts.caught((signal.SIGTERM,)):
        interrupts.ignore()
        signal.raise_signal(signal.SIGTERM)
        interrupts.throw(Hung("too late"))


def test_another_thread_throws_an_error_into_this_one_that_no_except_of_exceptions_catches():
    interrupts, hung = Interrupts(), Hung("cycle 7")
    with interrupts.caught((signal.SIGTERM,)):
        thread = threading.Thread(target=interrupts.throw, args=(hung,))
        with pytest.raises(Hung) as caught:  # noqa: PT012 - it comes from elsewhere
            thread.start()
            thread.join()
    assert caught.value is hung
    assert not isinstance(hung, Exception)


def test_nothing_is_thrown_where_nothing_is_caught():
    interrupts = Interrupts()
    with interrupts.caught((signal.SIGTERM,)):
        pass
    interrupts.throw(Hung("after"))  # the signal would end this process


def test_in_another_thread_nothing_is_caught_and_nothing_fails():
    before, seen = signal.getsignal(signal.SIGTERM), []

    def other():
        with Interrupts().caught((signal.SIGTERM,)):
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert seen == [before]


@pytest.mark.parametrize(
    ("number", "called", "outcome"),
    [
        (signal.SIGINT, "stop", "modules are stopped"),
        (signal.SIGTERM, "stop", "modules are stopped"),
        (ESTOP_SIGNAL, "at once", "module clear"),
    ],
)
@pytest.mark.parametrize("confirmed", [True, False])
def test_a_signal_stops_the_modules_and_the_one_of_an_emergency_stop_at_once(number, called, outcome, confirmed):
    calls = []

    def stop(what):
        calls.append(what)
        signal.raise_signal(number)  # which does not disturb it
        if not confirmed:
            raise HardwareError("nor does a module that does not confirm")

    said = outcome if confirmed else "NOT CONFIRMED that modules are stopped: nor does"
    with pytest.raises(Interrupted, match=said) as caught, stopping(lambda: stop("stop"), lambda: stop("at once")):
        signal.raise_signal(number)
    assert caught.value.number == number
    assert calls == [called]


@pytest.mark.parametrize("error", [None, ZeroDivisionError])
@pytest.mark.parametrize("refused", [None, HardwareError("not confirmed")])
def test_modules_are_stopped_at_the_end_whatever_it_is_and_no_signal_disturbs_that(error, refused):
    calls = []

    def stop():
        signal.raise_signal(signal.SIGTERM)
        calls.append("stop")
        if refused:
            raise refused

    expected = error or (HardwareError if refused else None)
    with pytest.raises(expected) if expected else nullcontext(), stopping(stop, lambda: calls.append("at once")):
        assert calls == []
        if error:
            raise error
    assert calls == ["stop"]
