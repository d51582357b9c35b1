import pytest

import tensionlab as tl
from tensionlab.viewer.state import begin
from tests.helpers.browsers import chromium


@pytest.fixture(scope="module")
def chromium_of_module():
    with chromium() as opened:
        yield opened


@pytest.fixture
def browser(chromium_of_module):
    """A browser without pages, one for all tests of a module."""
    yield chromium_of_module
    for context in chromium_of_module.contexts:
        context.close()


@pytest.fixture
def point():
    """The published rig, as the design page shows it at first."""
    return begin(tl.load_rig("bartels2026-validation"))
