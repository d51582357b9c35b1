import os

import pytest


@pytest.fixture
def locks_folder(tmp_path, monkeypatch):
    """Claims of this test are nobody else's; they lie there."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path / f"tensionlab-{os.getuid()}"
