"""The pages of the command line are of the commands that there are."""

from tensionlab.cli import VERBS
from tools.site.command_line import escape, pages

PAGES = pages()


def test_every_verb_has_a_page():
    assert list(PAGES) == list(VERBS)
    assert all(text.startswith(f"# tensionlab {name}\n") for name, text in PAGES.items())


def test_a_page_has_usage_arguments_and_options_as_help_does():
    page = PAGES["allocate"]
    assert "tensionlab allocate [OPTIONS]" in page
    assert "| `--wrench FX FY ...` | Desired wrench in N (and N·m). \\[required\\] |" in page
    assert "--help" not in page


def test_what_is_below_a_verb_is_on_its_page():
    assert "\n## tensionlab rig check\n" in PAGES["rig"]


def test_what_markdown_would_read_is_escaped():
    assert escape("a | b,\n *c*  [d] `--at X`") == "a \\| b, \\*c\\* \\[d\\] `--at X`"


def test_values_to_choose_from_stay_in_one_cell():
    assert "| `--preset ideal\\|paper-like` | " in PAGES["validate"]
