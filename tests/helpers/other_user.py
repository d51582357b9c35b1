"""Another user of this machine: code that runs as the user `nobody`, in a child of the tests' process."""

import json
import os
import pwd
from contextlib import contextmanager

import pytest

needs_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can become another user"
)


@contextmanager
def as_nobody(act):
    """Run a function as nobody, and keep what it holds until the end; gives its answer, of what JSON has.

    It is a fork: nobody may not read the interpreter of root, so all that is imported must be so already.
    """
    answers, answer = os.pipe()
    ends, end = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.setgroups([])
            os.setgid(pwd.getpwnam("nobody").pw_gid)
            os.setuid(pwd.getpwnam("nobody").pw_uid)
            found = act()  # held until the end
            os.write(answer, json.dumps(found[0]).encode())
        except BaseException as error:
            os.write(answer, json.dumps(repr(error)).encode())
        finally:
            os.close(answer)
            os.close(end)
            os.read(ends, 1)
            os._exit(0)
    os.close(answer)
    os.close(ends)
    try:
        with os.fdopen(answers) as file:
            yield json.loads(file.read())
    finally:
        os.close(end)
        os.waitpid(child, 0)
