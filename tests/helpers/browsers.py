"""A real browser at a design page: Debian's Chromium, driven by Playwright, with WebGL in software."""

import re
from contextlib import contextmanager

import numpy as np
import pytest

from tensionlab.model.files import load_rig
from tensionlab.viewer.design_page import DesignPage
from tensionlab.viewer.server import PageServer
from tests.helpers.scripts import HANGS_S, until
from tools.site.browser import SOFTWARE_WEBGL as OPTIONS
from tools.site.browser import installed

VISER = "viser-v1.1.1"  # subprotocol of viser's WebSocket
BROWSER = installed()
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium here")


@contextmanager
def chromium():
    """A browser, and nothing of it after."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=OPTIONS)
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def served(rig="bartels2026-validation", host="127.0.0.1"):
    """A design page of a rig."""
    page = DesignPage(load_rig(rig), PageServer(host), rig)
    try:
        yield page
    finally:
        page.close()


class Tab:
    """Tab of a browser that shows a design page; the mouse goes to places of the scene."""

    def __init__(self, browser, page):
        self.page = page
        known = set(page.server.viser.get_clients())
        self.tab = browser.new_page(viewport={"width": 960, "height": 600})
        self.tab.set_default_timeout(1000.0 * HANGS_S)
        self.requests, self.errors = [], []
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.on("console", lambda line: line.type == "error" and self.errors.append(line.text))
        self.tab.goto(page.server.url)
        (number,) = until(lambda: set(page.server.viser.get_clients()) - known, "the browser")
        self.wait_for("capacity margin")
        self.settle()
        self.client = page.server.viser.get_clients()[number]

    def settle(self):
        """Wait until what is shown has been drawn."""
        for _ in range(5):
            self.tab.evaluate("new Promise(done => requestAnimationFrame(done))")

    def wait_for(self, text):
        """Wait until the page says something."""
        self.tab.get_by_text(text, exact=True).wait_for()

    def press(self, label):
        """Press a button of the panel."""
        self.tab.get_by_role("button", name=label, exact=True).click()

    def click_tab(self, label):
        """Open a tab of the panel."""
        self.tab.get_by_role("tab", name=label, exact=True).click()

    def open_folder(self, label):
        """Open a folder of the panel."""
        self.tab.get_by_text(label, exact=True).locator("visible=true").click()

    def enter(self, label, text):
        """Enter text into a field of the panel."""
        # Labels of viser are next to their fields, and not tied to them.
        self.tab.locator(f'//*[normalize-space(text())="{label}"]/following::input[1]').fill(text)

    def check(self, label):
        """Tick a box of the panel."""
        self.tab.locator(f'//*[normalize-space(text())="{label}"]/following::input[1]').check()

    def pixel(self, place):
        """Where in the window a place of the scene is."""
        camera = self.client.camera
        ahead = camera.look_at - camera.position
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, camera.up_direction)
        right /= np.linalg.norm(right)
        away = np.asarray(place) - camera.position
        box = self.tab.locator("canvas").first.bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        reach = (away @ ahead) * np.tan(camera.fov / 2) / (box["height"] / 2)  # m in the scene for a pixel
        return x + away @ right / reach, y - away @ np.cross(right, ahead) / reach

    def drag(self, start, end, steps=10):
        """Drag from a place of the scene to where another is in the window."""
        mouse = self.tab.mouse
        mouse.move(*self.pixel(start))
        mouse.down()
        (x0, y0), (x1, y1) = self.pixel(start), self.pixel(end)
        for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
            mouse.move(x0 + share * (x1 - x0), y0 + share * (y1 - y0))
            self.tab.wait_for_timeout(30.0)
        mouse.up()


def plain(html):
    """The words of HTML."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", html)).strip()
