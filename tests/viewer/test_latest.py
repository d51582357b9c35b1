"""The thread that works on the newest of what is wanted."""

import threading

from tensionlab.viewer.latest import Latest
from tests.helpers.browsers import HANGS_S


def test_it_outlives_what_fails(caplog):
    failed, done = threading.Event(), threading.Event()

    def work(item, wanted):
        if item == "impossible":
            failed.set()
            raise ValueError("shapes differ")
        done.set()

    worker = Latest("example", work)
    worker.want("impossible")
    assert failed.wait(HANGS_S)
    worker.want("possible")
    assert done.wait(HANGS_S)
    worker.close()
    assert caplog.messages == ["view example: ValueError: shapes differ"]
