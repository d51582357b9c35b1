import io

import pytest

from tensionlab.workspace.sweep import progress


class Terminal(io.StringIO):
    def isatty(self):
        return True


def drive(monkeypatch, stream, seconds, shown=True):
    """What is written on a stream while two of four million poses are finished."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(progress.sys, "stderr", stream)
    with progress.bar(4_000_000, 1_000_000, shown) as advance:
        now[0] = seconds
        advance(1_000_000)
    return stream.getvalue()


def test_the_bar_says_how_far_how_fast_and_how_long(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    said = drive(monkeypatch, Terminal(), 4.0)
    assert "2,000,000 of 4,000,000 poses, 250,000/s" in said
    assert "0:00:08 left" in said


@pytest.mark.parametrize(
    ("stream", "seconds", "shown"), [(Terminal(), 1.0, True), (Terminal(), 4.0, False), (io.StringIO(), 4.0, True)]
)
def test_no_bar_for_short_work_or_none_to_see_it(monkeypatch, stream, seconds, shown):
    assert drive(monkeypatch, stream, seconds, shown) == ""
