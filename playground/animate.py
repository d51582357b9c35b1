"""Draw the animation of the front page from the playground: ``python playground/animate.py`` (needs Chromium).

A desired force goes around and leaves what seven modules can exert; the page answers each frame as it does in a
browser. Writes docs/images/playground.webp.
"""

from __future__ import annotations

import io
import math
from typing import Any

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from playground.build import PAGE, ROOT, report
from tools.site.browser import installed

PICTURE = ROOT / "docs" / "images" / "playground.webp"
MAX_BYTES = 700_000
WIDTH, HEIGHT = 720, 405
FRAMES, FRAME_MS, QUALITY = 48, 90, 45
TURN = 0.5  # rad by which the camera swings
SHOW = """([wrench, yaw]) => new Promise(done => {
  const { app } = tensionlab;
  app.camera.yaw = yaw;
  app.change({ wrench });
  requestAnimationFrame(() => requestAnimationFrame(done));
})"""


def path(share: float) -> list[Any]:
    """Return the desired force in N and the camera's yaw in rad at a share of the way, which is closed."""
    angle = 2 * math.pi * share
    size = 7.5 + 5.5 * math.sin(angle - 0.5)
    force = [size * math.cos(angle), 0.55 * size + 1.0 * math.sin(2 * angle), 0.6 * size * math.sin(angle)]
    return [[round(x, 3) for x in force], 0.6 + TURN / 2 * math.sin(angle)]


def frames(page: Page) -> list[Image.Image]:
    """Return the pictures of a closed path."""
    drawn = []
    for i in range(FRAMES):
        page.evaluate(SHOW, path(i / FRAMES))
        drawn.append(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
    return drawn


def main() -> None:
    """Write the animation, and print its size."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=installed(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
        page.set_default_timeout(600_000)
        page.goto(f"{PAGE.as_uri()}#rig=seven-modules&show=polytope&embed")
        page.wait_for_function("globalThis.tensionlab?.app.answer")
        first, *others = frames(page)
        browser.close()
    first.save(PICTURE, save_all=True, append_images=others, duration=FRAME_MS, loop=0, quality=QUALITY, method=6)
    report(PICTURE, MAX_BYTES)


if __name__ == "__main__":
    main()
