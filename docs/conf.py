"""Configuration of the documentation site, for Sphinx; `make docs` builds it.

The sources are the Markdown files and notebooks of the whole repository, where they are: links between them
work on GitHub as they do on the site.
"""

import os
import re
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from numpydoc.xref import DEFAULT_LINKS  # noqa: E402

import tensionlab as tl  # noqa: E402

DEFAULT_LINKS.clear()  # Python's own types are plain words: no links to other sites

project = "tensionlab"
author = "The tensionlab authors"
copyright = f"2026, {author}"  # noqa: A001 - Sphinx's name
version = release = tl.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_nb",
    "sphinx_design",
    "sphinx_copybutton",
    "tools.site.mathml",
    "tools.site.references",
    "tools.site.pictures",
    "tools.site.cards",
    "tools.site.command_line",
]
root_doc = "docs/index"
include_patterns = [
    "docs/**",
    "notebooks/*.ipynb",
    "CHANGELOG.md",
    "CODE_OF_CONDUCT.md",
    "CONTRIBUTING.md",
    "RELEASING.md",
    "SECURITY.md",
    "paper/README.md",
    "datasets/README.md",
    "datasets/*/README.md",
    "firmware/*.md",
    "kit/*.md",
    "paper_figures/README.md",
]
exclude_patterns = [".*", "build", "out", "tensionlab", "tests", "docs/figures/*.md", "docs/templates"]
nitpicky = True
smartquotes_action = "qe"  # quotes and ellipses, but no dashes: `--at` in the help of a command stays as it is

# Markdown: pages with cells of code are run where they changed. Notebooks are as `make notebooks` stored them.
myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "build" / "site" / "notebooks")
nb_execution_excludepatterns = ["notebooks/*.ipynb"]
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_output_stderr = "warn"
nb_ipywidgets_js = {}  # nothing is fetched
nb_merge_streams = True
html_math_renderer = "mathml"

# The reference: types stand in the docstrings, so signatures are short.
default_role = "py:obj"
autosummary_generate = True
# Names that are listed of several modules: the titles of their pages have the module in front.
LISTED = "\n".join(path.read_text(encoding="utf-8") for path in Path(__file__).parent.glob("reference/*.md"))
NAMES = Counter(re.findall(r"^   ~?tensionlab\.[\w.]*?(\w+)$", LISTED, re.MULTILINE))
autosummary_context = {"shared": [name for name, times in NAMES.items() if times > 1]}
autodoc_typehints = "none"
autodoc_default_options = {"members": True, "show-inheritance": False}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = {
    name: f"{module}.{name}"
    for module, names in (("tensionlab", tl.__all__), ("tensionlab.workspace", tl.workspace.__all__))
    for name in names
    if name[0].isupper()
}
add_module_names = False
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"
modindex_common_prefix = ["tensionlab."]

html_theme = "pydata_sphinx_theme"
html_title = "tensionlab"
html_favicon = "static/icon.svg"
html_static_path = ["static"]
html_extra_path = ["extra"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
templates_path = ["docs/templates"]  # seen from the root of the repository
html_sidebars = {"docs/index": [], "docs/which-solver": [], "docs/glossary": []}
html_theme_options = {
    "logo": {
        "text": "tensionlab",
        "image_light": "static/icon.svg",
        "image_dark": "static/icon-dark.svg",
        "alt_text": "Four cables that pull on one point",
    },
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "header_dropdown_text": "More",
    "show_toc_level": 2,
    "navigation_depth": 3,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
# Beside sites of other versions (tools/site/versions.py) a menu leads from one to another.
if "TENSIONLAB_DOCS_VERSION" in os.environ:
    html_theme_options |= {
        "switcher": {"json_url": "../switcher.json", "version_match": os.environ["TENSIONLAB_DOCS_VERSION"]},
        "check_switcher": False,
        "navbar_end": ["version-switcher", "theme-switcher"],
        "show_version_warning_banner": True,
    }
copybutton_prompt_text = r">>> |\.\.\. "
copybutton_prompt_is_regexp = True
