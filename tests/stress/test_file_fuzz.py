"""Damaged files of every kind that the program reads: they are read, or refused in words.

Each file is made as it should be, and then mutated: its content, with other types, huge numbers, missing, repeated
or unknown keys, nesting and control characters, so that many mutations get far beyond the parser; or its bytes.
What is read is used as the program would use it. Allowed are an answer and the package's own errors, within
`SLOWEST_S` and `MEMORY_BYTES`, without warnings. `make file-fuzz` takes more cases.
"""

import contextlib
import random
import signal
from pathlib import Path

import pytest

from tensionlab.errors import MAX_MESSAGE_CHARACTERS, TensionlabError
from tests.stress import cases
from tests.stress.file_kinds import KINDS, write

resource = pytest.importorskip("resource")
SLOWEST_S = 10.0  # longest time for a reading, in s of the processor
MEMORY_BYTES = 4_000_000_000  # address space that the readings may add to the process


class TooSlow(BaseException):
    """A reading that takes too long; no reader catches it."""


@contextlib.contextmanager
def limited():
    """Bound the processor time and the memory of a block."""

    def stop(*_):
        raise TooSlow(f"more than {SLOWEST_S:g} s")

    before, (soft, hard) = signal.signal(signal.SIGPROF, stop), resource.getrlimit(resource.RLIMIT_AS)
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + MEMORY_BYTES, hard))
    signal.setitimer(signal.ITIMER_PROF, SLOWEST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@pytest.mark.parametrize("name", KINDS)
def test_damaged_files_are_read_or_refused_in_words(name, tmp_path):
    kind, messages = KINDS[name], []
    place = tmp_path / f"case{kind.suffix}"
    kind.read(write(kind.encode(kind.document()), place))
    for case in range(cases(10)):
        write(kind.case(random.Random(f"1 {name} {case}")), place)
        with limited():
            try:
                kind.read(place)
            except TensionlabError as error:
                messages.append(str(error).replace(str(tmp_path), ""))
            except BaseException as error:
                error.add_note(f"case {case} of {name}")
                raise
    assert 0 < max(map(len, messages)) <= MAX_MESSAGE_CHARACTERS, "some are refused, and not at length"


def test_a_reading_without_end_is_stopped(monkeypatch):
    monkeypatch.setattr("tests.stress.test_file_fuzz.SLOWEST_S", 0.1)
    with pytest.raises(TooSlow), limited():
        all(iter(lambda: 1, 0))
