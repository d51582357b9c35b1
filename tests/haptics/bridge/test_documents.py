from pathlib import Path

from tensionlab.haptics.bridge.documents import document


def test_the_page_is_that_of_the_code():
    page = Path(__file__).parents[3] / "BRIDGE.md"
    again = "python -m tensionlab.haptics.bridge.documents writes it"
    assert page.read_text(encoding="utf-8") == document(), again
