import pytest

import tensionlab as tl
from tensionlab.viewer.state import begin


@pytest.fixture
def point():
    """The published rig, as the design page shows it at first."""
    return begin(tl.load_rig("bartels2026-validation"))
