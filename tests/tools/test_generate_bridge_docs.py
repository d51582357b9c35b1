from pathlib import Path

from tools.generate_bridge_docs import document


def test_the_page_is_that_of_the_code():
    page = Path(__file__).parents[2] / "BRIDGE.md"
    again = "python -m tools.generate_bridge_docs writes it"
    assert page.read_text(encoding="utf-8") == document(), again
