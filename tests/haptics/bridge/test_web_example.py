"""The web page of `examples/web`, in a real browser, with a real bridge."""

import http.server
import signal
import threading
from contextlib import contextmanager
from functools import partial

import pytest

from tests.haptics.bridge.test_real_clients import ROOT, served
from tools.site.browser import browser, installed

NEWTONS = "[...document.getElementById('measured').textContent.matchAll(/-?[0-9.]+/g)].map(Number)"
STATUS = "document.getElementById('status').textContent"


@contextmanager
def examples():
    """The examples on a server; gives its URL."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    handler = partial(Quiet, directory=ROOT / "examples")
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def drag(page, canvas, begin, end):
    """Press the pointer at a place of a canvas, in shares of its size, and release it at another."""
    box = page.locator(f"#{canvas}").bounding_box()
    for (across, down), act in ((begin, page.mouse.down), (end, page.mouse.up)):
        page.mouse.move(box["x"] + across * box["width"], box["y"] + down * box["width"])
        act()


@pytest.mark.slow
@pytest.mark.skipif(installed() is None, reason="no Chromium here")
def test_a_hand_in_a_web_page_feels_a_wall_and_the_page_finds_the_bridge_again():
    with examples() as site, browser() as (page, seen):
        page.set_viewport_size({"width": 1200, "height": 800})
        with served() as (url, running):
            page.goto(f"{site}/web/index.html?bridge={url}")
            page.wait_for_function(f"{STATUS}.startsWith('connected')")
            # The wall is 5 cm below the hand, which goes 7 cm down: 2 cm into it, at 100 N/m.
            drag(page, "front", (0.5, 0.5), (0.5, 0.5 + 0.07 / 0.4))
            up = page.wait_for_function(
                f"(([x, y, z]) => y > 1.8 && y < 2.2 && [x, y, z])({NEWTONS})"
            ).json_value()
            assert up[0] == pytest.approx(0.0, abs=0.1)
            assert up[2] == pytest.approx(0.0, abs=0.1)
            # Up again, and a soft spring to where it began pulls it back from the side.
            drag(page, "front", (0.5, 0.5 + 0.07 / 0.4), (0.5, 0.5))
            page.evaluate("document.getElementById('kind').value = 'spring'")
            page.evaluate("document.getElementById('strength').value = 30")
            drag(page, "side", (0.5, 0.5), (0.5 + 0.03 / 0.4, 0.5))
            page.wait_for_function(f"(([x, y, z]) => z < -0.8 && Math.hypot(x, y) < 0.1)({NEWTONS})")
            running.send_signal(signal.SIGINT)
            page.wait_for_function(f"{STATUS}.endsWith('trying again')")
        with served(port=url.rsplit(":", 1)[1]):
            page.wait_for_function(f"{STATUS}.startsWith('connected')")
            page.wait_for_function(f"(([x, y, z]) => z < -0.8)({NEWTONS})")
            page.evaluate("document.getElementById('stop').click()")
            page.wait_for_function("document.getElementById('events').textContent.includes('stop')")
        assert [each for each in seen.complaints if "WebSocket" not in each] == []
