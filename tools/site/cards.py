"""Cards for the lists of tutorials and how-tos: on the site each entry has a part of one of its pictures.

In the Markdown they are lists of links with a sentence each, as a code host shows them.
"""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import Any

import nbformat
from docutils import nodes
from PIL import Image, ImageOps
from sphinx.transforms import SphinxTransform

ROOT = Path(__file__).parents[2]
FOLDER = Path("docs/cards")
SIZE = (640, 320)  # pixels
PAGES = ("docs/how-to/index", "docs/tutorials/index")
# Picture for the card of each page: a file, or a notebook and its cell that draws one; and the part of it that is
# shown, from left, top, right and bottom, in percent.
PICTURES: dict[str, tuple[str, tuple[int, int, int, int]]] = {
    "01_allocation": ("notebooks/01_allocation.ipynb#cell-7", (0, 0, 100, 100)),
    "02_solver_benchmark": ("docs/figures/time-accuracy.png", (0, 0, 100, 92)),
    "03_workspace": ("notebooks/03_workspace.ipynb#cell-9", (15, 15, 85, 90)),
    "04_design_a_rig": ("notebooks/04_design_a_rig.ipynb#cell-5", (0, 12, 100, 92)),
    "05_hardware": ("notebooks/05_hardware.ipynb#cell-4", (0, 2, 100, 38)),
    "06_validation": ("notebooks/06_validation.ipynb#cell-6", (0, 6, 100, 92)),
    "07_scenarios": ("notebooks/07_scenarios.ipynb#cell-3", (0, 4, 45, 62)),
    "08_mujoco": ("notebooks/08_mujoco.ipynb#cell-9", (0, 0, 100, 100)),
    "09_gradients": ("notebooks/09_gradients.ipynb#cell-7", (0, 0, 100, 100)),
    "allocate-tensions": ("docs/figures/wrench-set.png", (0, 0, 100, 100)),
    "design-a-rig": ("notebooks/04_design_a_rig.ipynb#cell-7", (0, 0, 100, 100)),
    "keep-cables-clear-of-a-person": ("docs/figures/scenario-layouts.png", (48, 3, 70, 46)),
    "design-in-the-browser": ("docs/images/view.png", (2, 5, 70, 98)),
    "analyse-a-workspace": ("docs/figures/anchor-count.png", (49, 50, 100, 88)),
    "check-a-suspended-robot": ("docs/images/proved-workspace.png", (0, 8, 100, 92)),
    "make-a-rig-stiff": ("docs/figures/workspace.png", (50, 0, 100, 50)),
    "check-a-trajectory": ("notebooks/02_solver_benchmark.ipynb#cell-5", (0, 5, 100, 52)),
    "sweep-on-a-cluster": ("notebooks/03_workspace.ipynb#cell-11", (0, 0, 100, 100)),
    "bring-a-caspr-model": ("notebooks/03_workspace.ipynb#cell-7", (0, 0, 100, 50)),
    "join-the-benchmark": ("docs/figures/solver-newton.png", (0, 0, 100, 88)),
    "compare-solvers": ("docs/images/compare.png", (0, 0, 60, 55)),
    "differentiate-an-allocation": ("notebooks/09_gradients.ipynb#cell-3", (0, 0, 100, 100)),
    "allocate-in-c-and-cpp": ("docs/figures/policies.png", (0, 0, 100, 100)),
    "add-a-solver": ("docs/figures/solver-dykstra.png", (0, 0, 100, 88)),
    "build-a-module": ("notebooks/01_allocation.ipynb#cell-1", (10, 8, 90, 92)),
    "calibrate": ("docs/figures/error-sphere.png", (0, 8, 52, 80)),
    "run-modules": ("docs/images/run.png", (0, 2, 100, 42)),
    "open-a-log-in-foxglove": ("docs/images/replay.png", (2, 5, 62, 98)),
    "simulate-with-mujoco": ("docs/images/carry.png", (0, 0, 100, 70)),
    "use-it-in-a-study": ("docs/images/run.png", (0, 55, 100, 100)),
    "validate-a-rig": ("docs/figures/forces.png", (0, 8, 100, 92)),
    "characterise-a-rig": ("docs/figures/wall-stiffness.png", (0, 0, 100, 92)),
    "render-haptics": ("docs/images/scenario-bow.png", (45, 4, 100, 62)),
    "drive-it-from-a-game-engine": ("docs/images/playground.webp", (0, 0, 100, 100)),
    "write-a-scenario": ("docs/figures/scenario-layouts.png", (0, 3, 100, 97)),
    "add-an-effect": ("notebooks/07_scenarios.ipynb#cell-5", (0, 0, 100, 100)),
}


def draw(source: str, part: tuple[int, int, int, int]) -> Image.Image:
    """Return the picture of a card, on white."""
    path, _, cell = source.partition("#")
    file: Any = ROOT / path
    if cell:
        cells = nbformat.read(file, as_version=4).cells  # type: ignore[no-untyped-call]
        data = next(each for each in cells if each.id == cell).outputs[-1].data
        file = io.BytesIO(base64.b64decode(data["image/png"]))
    picture = Image.open(file).convert("RGBA")
    picture = Image.alpha_composite(Image.new("RGBA", picture.size, "white"), picture).convert("RGB")
    width, height = picture.size
    left, top, right, bottom = part
    picture = picture.crop(
        (left * width // 100, top * height // 100, right * width // 100, bottom * height // 100)
    )
    return ImageOps.pad(picture, SIZE, Image.Resampling.LANCZOS, color="white")


def write(app: Any) -> None:
    """Write the pictures of all cards."""
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(exist_ok=True)
    for name, (source, part) in PICTURES.items():
        draw(source, part).save(folder / f"{name}.webp", quality=88)


class Cards(SphinxTransform):  # type: ignore[misc]
    """Gives the entries of a list of pages their pictures."""

    default_priority = 500

    def apply(self, **_: Any) -> None:
        """Go through the lists of a page."""
        if self.env.docname not in PAGES:
            return
        for each in self.document.findall(nodes.bullet_list):
            each["classes"].append("cards")
            for item in each.children:
                link, *rest = item[0].children
                name = Path(link.get("reftarget", link.get("refuri", ""))).stem
                uri = f"/{FOLDER.as_posix()}/{name}.webp"
                item.insert(0, nodes.image(uri=uri, alt=link.astext()))
                if rest:
                    words = rest[0].astext().lstrip(":, ")
                    rest[0].parent.replace(rest[0], nodes.Text(words[:1].upper() + words[1:]))


def setup(app: Any) -> dict[str, bool]:
    """Connect to Sphinx, before it looks for pages."""
    app.connect("builder-inited", write, priority=100)
    app.add_transform(Cards)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
