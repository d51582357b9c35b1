"""Pictures of docs/images, drawn by the commands of the pages that show them.

``python paper_figures/pictures.py`` draws all, or those that are named, such as ``run.png``. Those of the browser
need Chromium, and the playground, which ``make playground`` builds.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import stamps

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs" / "images"
SETTLE_MS = 8000  # after which a page in software rendering shows all it has


@dataclass(frozen=True)
class Picture:
    """Picture and the files that draw it.

    It is what ``written`` is after the commands of ``page``'s block of code that has this name in it; or what
    ``draw`` writes to a path.
    """

    sources: tuple[str, ...]
    page: str = ""
    written: str = ""
    draw: Callable[[Path], None] | None = None

    @property
    def block(self) -> tuple[str, str]:
        """Language and text of the block of code; none without a page."""
        if not self.page:
            return "", ""
        blocks = re.findall(r"^```(sh|python)\n(.*?)^```", self._text, re.MULTILINE | re.DOTALL)
        return next((language, code) for language, code in blocks if self.written in code)

    @property
    def files(self) -> dict[str, str]:
        """Files that the page gives, by their names."""
        named = r"`([\w-]+\.toml)`:\s+```toml\n(.*?)^```"
        return {name: text for name, text in re.findall(named, self._text, re.M | re.S) if name in self.block[1]}

    @property
    def _text(self) -> str:
        return (ROOT / "docs" / self.page).read_text(encoding="utf-8") if self.page else ""

    @property
    def stamp_text(self) -> str:
        """All that the page says of how to draw it."""
        return "\n".join([*self.block, *self.files.values()])


def run_block(picture: Picture, out: Path) -> None:
    """Run the block of a page in an empty folder, and take what it writes."""
    language, code = picture.block
    program = ["bash", "-ec", code] if language == "sh" else [sys.executable, "-c", code]
    binaries = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "examples").symlink_to(ROOT / "examples")
        for file, text in picture.files.items():
            (folder / file).write_text(text, encoding="utf-8")
        environment = os.environ | {"PATH": binaries, "MPLBACKEND": "agg"}
        subprocess.run(program, cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
        shutil.copyfile(folder / picture.written, out)


def shoot(command: list[str], out: Path, prepare: Callable[[Any], None]) -> None:
    """Take a picture of the page that a command serves, after what prepares it."""
    from playwright.sync_api import sync_playwright

    from tools.site.browser import SOFTWARE_WEBGL, installed

    command = [sys.executable, "-m", "tensionlab", *command, "--no-browser"]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as server:
        try:
            assert server.stdout is not None
            address = next(found[0] for line in server.stdout if (found := re.search(r"http://\S+", line)))
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=installed(), args=SOFTWARE_WEBGL)
                page = browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme="light")
                page.set_default_timeout(600_000)
                page.goto(address)
                page.wait_for_selector("canvas")
                page.wait_for_timeout(SETTLE_MS)
                for button in page.locator(".mantine-Notification-closeButton").all():
                    button.click()  # says that rendering is in software
                prepare(page)
                page.wait_for_timeout(SETTLE_MS)
                page.screenshot(path=out)
                browser.close()
        finally:
            server.terminate()


def draw_view(out: Path) -> None:
    """Take a picture of the page on which a rig is designed, with a force beyond what it can render."""

    def pull(page: Any) -> None:
        force = page.locator("input[inputmode]").nth(3)
        force.fill("12")
        force.press("Enter")

    shoot(["view", "seven-modules"], out, pull)


def draw_replay(out: Path) -> None:
    """Play a scenario, and take a picture of its log."""
    with tempfile.TemporaryDirectory() as folder:
        log = str(Path(folder) / "materials.mcap")
        program = [sys.executable, "-m", "tensionlab", "scenario", "materials", "--log", log]
        subprocess.run(program, check=True, stdout=subprocess.DEVNULL)
        shoot(["log", "view", log], out, lambda page: page.get_by_role("button", name="Next event").click())


def draw_playground(out: Path) -> None:
    """Draw the animation of the first page; the playground's script knows where to."""
    subprocess.run(
        [sys.executable, "playground/animate.py"], cwd=ROOT, check=True, env=os.environ | {"PYTHONPATH": "."}
    )


PLOTS = "tensionlab/plots/"
PICTURES = {
    "compare.png": Picture((PLOTS + "comparison.py", *stamps.COMMON), "how-to/compare-solvers.md", "compare.png"),
    "run.png": Picture((PLOTS + "run.py", *stamps.COMMON), "how-to/run-modules.md", "shake.png"),
    "proved-workspace.png": Picture(
        (PLOTS + "workspace.py", *stamps.COMMON), "how-to/analyse-a-workspace.md", "proved.png"
    ),
    "losses.png": Picture((PLOTS + "workspace.py", *stamps.COMMON), "how-to/analyse-a-workspace.md", "losses.png"),
    "scenario-bow.png": Picture(
        (PLOTS + "scenario.py", PLOTS + "scene.py", "tensionlab/scenarios/files/bow.toml", *stamps.COMMON),
        "how-to/render-haptics.md",
        "bow.png",
    ),
    "carry.png": Picture(
        ("examples/mujoco/carry.py", *stamps.COMMON), "how-to/simulate-with-mujoco.md", "carry.png"
    ),
    "view.png": Picture(
        (
            "tensionlab/viewer/design_*.py",
            "tensionlab/viewer/templates/design.html",
            "tensionlab/support/colours.py",
            "datasets/rigs/seven-modules.toml",
        ),
        draw=draw_view,
    ),
    "replay.png": Picture(
        (
            "tensionlab/viewer/replay.py",
            "tensionlab/viewer/run_scene.py",
            "tensionlab/viewer/templates/run.html",
            "tensionlab/support/colours.py",
        ),
        draw=draw_replay,
    ),
    "playground.webp": Picture(
        ("playground/*.js", "playground/page.html", "playground/animate.py"), draw=draw_playground
    ),
}  # by the name of the file


def main() -> None:
    """Draw the pictures, and write their stamps."""
    for name in sys.argv[1:] or PICTURES:
        picture, out = PICTURES[name], IMAGES / name
        if picture.draw:
            picture.draw(out)
        else:
            run_block(picture, out)
        stamps.update({f"images/{name}": stamps.stamp(out, picture.sources, picture.stamp_text)})
        print(out)


if __name__ == "__main__":
    main()
