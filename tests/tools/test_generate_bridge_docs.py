from pathlib import Path

import pytest

from tensionlab.haptics.bridge.schema import schema_text
from tools.generate_bridge_docs import SCHEMA_FILE, document


@pytest.mark.parametrize(("name", "made"), [("docs/reference/bridge.md", document), (SCHEMA_FILE, schema_text)])
def test_the_file_is_that_of_the_code(name, made):
    again = "python -m tools.generate_bridge_docs writes it"
    assert (Path(__file__).parents[2] / name).read_text(encoding="utf-8") == made(), again
