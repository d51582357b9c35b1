"""Pictures and their alternative text, also of those that notebooks draw; diagrams that GitHub draws itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util import logging

ROOT = Path(__file__).parents[2]
DIAGRAMS = {
    "stateDiagram-v2": (
        "/docs/figures/module-states.svg",
        "The states of a module, and what leads from one to another.",
    )
}  # picture of each Mermaid diagram, by its first line, and what it shows
LONGEST_CALL = 80  # characters of a call that describe a picture


class Mermaid(Directive):  # type: ignore[misc]
    """Block of Mermaid, which GitHub draws: on the site the picture that is drawn from the same source."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the picture, or the text of the diagram where there is none."""
        path, words = DIAGRAMS.get(self.content[0].strip(), ("", ""))
        if (ROOT / path.lstrip("/")).is_file():
            return [nodes.image(uri=path, alt=words, candidates={"*": path.lstrip("/")})]
        return [nodes.literal_block("\n".join(self.content), "\n".join(self.content), language="text")]


class Descriptions(SphinxPostTransform):  # type: ignore[misc]
    """Describes a picture that a notebook drew by the call that drew it, and warns of others without words."""

    default_priority = 900

    def run(self, **_: Any) -> None:
        """Go through the pictures of a page."""
        for image in self.document.findall(nodes.image):
            if image.get("alt"):
                continue
            cell = image.parent
            while cell is not None and "cell" not in cell.get("classes", []):
                cell = cell.parent
            if cell is None:
                logging.getLogger(__name__).warning("no alternative text: %s", image["uri"], location=image)
                continue
            code = next(cell.findall(nodes.literal_block)).astext()
            image["alt"] = f"Drawn by {code.strip().splitlines()[-1].strip():.{LONGEST_CALL}}"


def setup(app: Any) -> dict[str, bool]:
    """Connect to Sphinx."""
    app.add_directive("mermaid", Mermaid)
    app.add_post_transform(Descriptions)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
