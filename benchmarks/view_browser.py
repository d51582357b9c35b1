"""The design page in a process of its own, and a browser that drags and notes when what arrived and was drawn."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from benchmarks.processes import process
from tensionlab.model.files import load_rig
from tensionlab.model.kinematics import in_space
from tensionlab.support.arrays import Floats
from tensionlab.viewer.scene import place_camera
from tensionlab.viewer.state import begin
from tools.site.browser import installed

if TYPE_CHECKING:
    from playwright.sync_api import Page

# As a browser runs where there is no graphics card: WebGL and the page are drawn on the processor.
OPTIONS = ("--disable-gpu", "--enable-unsafe-swiftshader", "--no-sandbox", "--disable-dev-shm-usage")
WIDTH, HEIGHT = 1280, 800
HANGS_MS = 60_000.0
MOVE_S = 1 / 60  # between events of a mouse that moves
# Script that runs in the page before its own, and notes in `viewLog` what happens when, in ms.
HOOKS = """(() => {
  const log = window.viewLog = [], pending = new Map();
  let drawn = [], margin = null, gl = null;
  window.viewFrames = 0;
  const now = () => performance.now();
  addEventListener("pointermove", e => log.push({kind: "moved", at: e.timeStamp}), true);
  const Plain = window.Worker;
  window.Worker = class extends Plain {  // viser's has the WebSocket
    constructor(...words) {
      super(...words);
      this.addEventListener("message", ({data}) => {
        if (data?.type !== "message_batch") return;
        const arrays = {};
        let bytes = 0, first = null;
        for (const message of data.messages) {
          for (const [key, value] of Object.entries(message.updates ?? {})) {
            if (!ArrayBuffer.isView(value)) continue;
            const name = `${message.name} ${key}`, length = value.byteLength / 4;
            bytes += value.byteLength;
            arrays[name] = length;
            if (!["/cables points", "/workspace vertices"].includes(name)) continue;
            const start = Array.from(new Float32Array(value.buffer, value.byteOffset, 6));
            pending.set(start.join(), name);
            if (name === "/cables points") first = start;
          }
        }
        log.push({kind: "received", at: now(), count: data.messages.length, bytes, arrays, first});
      });
    }
    postMessage(data, ...more) {
      const message = data?.type === "send" ? data.message : null;
      if (message?.type === "SceneNodeDragMessage")
        log.push({kind: "sent", at: now(), phase: message.phase, place: message.end_position});
      super.postMessage(data, ...more);
    }
  };
  for (const name of ["bufferData", "bufferSubData"]) {
    const plain = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...words) {
      const array = words.find(ArrayBuffer.isView);
      if (array instanceof Float32Array && array.length >= 6) {
        const first = Array.from(array.slice(0, 6)), key = first.join();
        if (pending.has(key)) {
          drawn.push({kind: "drawn", what: pending.get(key), length: array.length, first});
          pending.delete(key);
          gl = this;
        }
      }
      return plain.apply(this, words);
    };
  }
  const frame = window.requestAnimationFrame.bind(window);
  window.requestAnimationFrame = call => frame(time => {
    call(time);
    window.viewFrames += 1;
    if (!drawn.length) return;
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));  // waits until the picture is there
    for (const each of drawn) log.push({...each, at: now()});
    drawn = [];
  });
  addEventListener("DOMContentLoaded", () => new MutationObserver(() => {
    const cell = [...document.querySelectorAll("td")].find(each => each.textContent === "capacity margin");
    const text = cell?.nextElementSibling?.textContent ?? null;
    if (text !== margin) log.push({kind: "text", at: now(), text});
    margin = text;
  }).observe(document.body, {subtree: true, childList: true, characterData: true}));
})()"""


@dataclass(frozen=True)
class Shown:
    """Page in a browser.

    Attributes
    ----------
    tab : Page
        Of Playwright.
    server : int
        Id of the process that serves it.
    anchor : (2,) array
        Where the first anchor is in the window, in pixels.
    """

    tab: Page
    server: int
    anchor: Floats

    def log(self, start: int = 0) -> list[dict[str, Any]]:
        """Return what has been noted, from an entry on."""
        return cast(list[dict[str, Any]], self.tab.evaluate(f"viewLog.slice({start})"))

    def count(self) -> int:
        """Return how much has been noted."""
        return int(self.tab.evaluate("viewLog.length"))

    def forget(self) -> None:
        """Drop what has been noted."""
        self.tab.evaluate("viewLog.length = 0")

    def choose(self, tab: str, label: str, option: str) -> None:
        """Choose an option in a list of a tab of the panel."""
        self.tab.get_by_role("tab", name=tab, exact=True).click()
        self.tab.locator(f'//*[normalize-space(text())="{label}"]/following::input[1]').click()
        self.tab.get_by_role("option", name=option, exact=True).click()

    def wander(self, steps: int, reach: float, start: float = 0.0) -> None:
        """Move the mouse around the first anchor, which it holds, as fast as a hand does."""
        for step in range(steps):
            began = time.perf_counter()
            self.tab.mouse.move(*self.place(start + step / 40, reach))
            time.sleep(max(0.0, MOVE_S - (time.perf_counter() - began)))

    def place(self, turns: float, reach: float) -> Floats:
        """Return a place in the window on a figure of eight next to the anchor, in pixels."""
        angle = 2 * np.pi * turns / 7
        return self.anchor + reach * np.array([np.sin(angle), 0.5 * np.sin(2 * angle) + 0.4 * np.sin(angle)])


@contextmanager
def shown(name: str) -> Iterator[Shown]:
    """Serve the design page of a rig, and show it in Chromium, which draws in software."""
    from playwright.sync_api import sync_playwright

    with process("view", name, "--no-browser") as serving, sync_playwright() as playwright:
        assert serving.stdout is not None
        url = serving.stdout.readline().split()[0]
        browser = playwright.chromium.launch(executable_path=installed(), args=OPTIONS)
        tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        tab.set_default_timeout(HANGS_MS)
        tab.add_init_script(HOOKS)
        tab.goto(url)
        tab.get_by_text("capacity margin", exact=True).wait_for()
        tab.wait_for_timeout(3_000.0)  # shaders are compiled
        box = tab.locator("canvas").first.bounding_box()
        assert box is not None
        yield Shown(tab, serving.pid, first_anchor(name, box))
        browser.close()


def first_anchor(name: str, box: Any) -> Floats:
    """Return where the first anchor of a rig is in the window, in pixels, as the page first shows it."""
    camera = SimpleNamespace()
    scene = SimpleNamespace(set_up_direction=lambda up: None)
    rig = load_rig(name)
    place_camera(cast(Any, SimpleNamespace(scene=scene, initial_camera=camera)), rig)
    return pixel(camera, camera.up, box, in_space(begin(rig).anchors)[0])


def pixel(camera: Any, up: Floats, box: Any, place: Floats) -> Floats:
    """Return where in the window a place of the scene is, (2,), that a camera sees in a box of the window."""
    ahead = camera.look_at - camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    away = np.asarray(place) - camera.position
    reach = (away @ ahead) * np.tan(camera.fov / 2) / (box["height"] / 2)  # m in the scene for a pixel
    middle = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    return np.asarray(middle + np.array([away @ right, -away @ np.cross(right, ahead)]) / reach)
