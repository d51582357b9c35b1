"""Errors keep what they carry, also on their way to another process."""

import pickle

import numpy as np
import pytest

import tensionlab as tl
from tensionlab.errors import ModuleFault, Unreachable, cannot_listen, optional_import
from tensionlab.hardware.protocol.codes import Fault


def test_a_modules_fault_reaches_another_process():
    fault = pickle.loads(pickle.dumps(ModuleFault('module "a" is too hot', "a", Fault(4))))
    assert (str(fault), fault.module, fault.code) == ('module "a" is too hot', "a", Fault(4))


def test_an_allocation_that_is_not_exact_reaches_another_process():
    result = tl.allocate([[1.0, -1.0]], [9.0], tl.TensionLimits([0.5, 0.5], [6.0, 6.0]))
    with pytest.raises(Unreachable) as raised:
        result.raise_for_status()
    sent = pickle.loads(pickle.dumps(raised.value))
    assert str(sent) == str(raised.value)
    np.testing.assert_array_equal(sent.allocation.tensions, result.tensions)


def test_a_missing_library_is_told_with_the_extra_that_brings_it():
    with pytest.raises(tl.errors.MissingDependency) as raised, optional_import("x", "a store"):
        import no_such_library.part  # noqa: F401
    assert str(raised.value) == 'a store needs no_such_library: pip install "tensionlab[x]"'


@pytest.mark.parametrize(
    ("reason", "said"),
    [
        (OSError(98, "Address already in use (while listening)"), ": Address already in use; give another port"),
        (OSError(-2, "Name or service not known"), ": Name or service not known; give another port"),
        (OSError(10048, "Only one usage (protocol/network)"), ": Only one usage; give another port"),
        ("another user has it", ": another user has it; give another port"),
    ],
)
def test_an_address_that_is_taken_is_told_with_the_reason(reason, said):
    assert said in str(cannot_listen("the bridge", "127.0.0.1", 80, reason))
