"""Check of the site in a real browser: ``python -m tools.site.check out/site``, or `make docs-check`.

Opens every page as wide as a desktop and a phone; follows every link and anchor within the site; checks that
pictures and equations are drawn and have words, that no code is cut off, that long pages list their sections, that
nothing is wider than a phone and nothing comes from elsewhere; and searches. Screenshots are in out/site-check.
"""

from __future__ import annotations

import argparse
import functools
import http.server
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urldefrag

from playwright.sync_api import Page, ViewportSize

from tools.site.browser import Seen, browser

DESKTOP, PHONE = (ViewportSize(width=width, height=900) for width in (1400, 390))
LONG = 2400  # pixels of a page from which on it lists its sections
HOME = "docs/index.html"
SHOTS = {
    "landing": HOME,
    "get-started": "docs/get-started/index.html",
    "tutorial": "notebooks/01_allocation.html",
    "concept": "docs/concepts/infeasible-wrenches.html",
    "allocate": "docs/reference/generated/api/tensionlab.allocate.html",
    "command-line": "docs/reference/generated/cli/allocate.html",
    "gallery": "docs/gallery/index.html",
    "how-to": "docs/how-to/index.html",
    "which-solver": "docs/which-solver.html",
}  # pages to look at; those that there are
# What is typed, and what one of the results is called.
SEARCHES = {"capacity margin": "capacity_margin", "allocate": "allocate", "separating direction": "Glossary"}
# What a page is asked at the width of a desktop.
LOOK = """(() => {
  const all = (name) => [...document.querySelectorAll(name)];
  return {
    links: all("a[href]").map((each) => each.href),
    ids: all("[id], a[name]").map((each) => each.id || each.name),
    pictures: all("img").length,
    broken: all("img").filter((each) => !each.complete || !each.naturalWidth).map((each) => each.src),
    wordless: all("img").filter((each) => !each.alt.trim()).map((each) => each.src),
    equations: all("math").length,
    flat: all("math").filter((each) => each.getClientRects().length && each.getBoundingClientRect().height < 4)
      .map((each) => each.getAttribute("alttext")),
    cut: all("article pre").filter((each) => each.scrollWidth > each.clientWidth)
      .map((each) => each.textContent.split("\\n").reduce((one, two) => one.length > two.length ? one : two)),
    long: document.documentElement.scrollHeight, sections: all("#pst-page-toc-nav a, .genindex-jumpbox a").length,
    empty: !document.querySelector("article, main, body > a") || !document.title,
  };
})()"""
# By how many pixels a page is wider than the window, and what is.
WIDE = """(() => {
  const {clientWidth: window, scrollWidth: page} = document.documentElement;
  if (page <= window) return [];
  const all = [...document.querySelectorAll("main *")];
  const wide = all.filter((each) => each.getBoundingClientRect().right > window + 1);
  return [page - window, ...wide.slice(0, 3).map((each) => each.outerHTML.slice(0, 80))];
})()"""
LAZY = 'document.querySelectorAll("img[loading=lazy]").forEach((each) => { each.loading = "eager"; })'
COMPLETE = "[...document.images].every((each) => each.complete)"
RESULTS = '[...document.querySelectorAll("#search-results li a")].map((each) => each.textContent)'


@dataclass
class Findings:
    """What was seen, and what is wrong."""

    pages: int = 0
    links: set[str] = field(default_factory=set)
    pictures: int = 0
    equations: int = 0
    searches: int = 0
    elsewhere: set[str] = field(default_factory=set)
    wrong: list[str] = field(default_factory=list)


@contextmanager
def serve(folder: Path) -> Iterator[str]:
    """Serve a folder on this machine; gives its address."""

    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=folder)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def check_pages(page: Page, seen: Seen, site: Path, base: str) -> Findings:
    """Open every page of a site, and then look whether there is what they link to."""
    found = Findings()
    ids: dict[str, set[str]] = {}
    links: list[tuple[str, str]] = []
    for path in sorted(site.rglob("*.html")):
        name = path.relative_to(site).as_posix()
        if name == "index.html" or name.startswith("_static/"):  # leads to docs/index.html; parts of the theme
            continue
        seen.requests.clear()
        seen.complaints.clear()
        page.set_viewport_size(DESKTOP)
        page.goto(base + name)
        page.evaluate(LAZY)
        page.wait_for_function(COMPLETE)
        look = page.evaluate(LOOK)
        page.set_viewport_size(PHONE)
        wide = page.evaluate(WIDE)
        found.pages += 1
        found.pictures += look["pictures"]
        found.equations += look["equations"]
        found.elsewhere |= {url for url in seen.requests if not url.startswith((base, "data:", "blob:"))}
        ids[name] = set(look["ids"])
        links += [(name, unquote(link.removeprefix(base))) for link in look["links"] if link.startswith(base)]
        for what, which in (
            ("picture does not load", look["broken"]),
            ("picture without words", look["wordless"]),
            ("equation is not drawn", look["flat"]),
            ("code is cut off", look["cut"]),
            ("says", seen.complaints),
        ):
            found.wrong += [f"{name}: {what}: {each}" for each in which]
        if wide:
            found.wrong.append(f"{name}: {wide[0]} px wider than a phone: {'; '.join(wide[1:])}")
        if look["long"] > LONG and not look["sections"] and name != HOME:
            found.wrong.append(f"{name}: {look['long']} px long without a list of its sections")
        if look["empty"]:
            found.wrong.append(f"{name}: is empty")
    found.links = {link for _, link in links}
    for name, link in dict.fromkeys(links):
        target, anchor = urldefrag(link)
        target = target.partition("?")[0]
        if not (site / target).is_file():
            found.wrong.append(f"{name}: no page {target}")
        elif anchor and anchor not in ids.get(target, ()):
            found.wrong.append(f"{name}: no anchor #{anchor} in {target}")
    return found


def check_search(page: Page, home: str, found: Findings, shot: Path | None = None) -> None:
    """Search from a page as a person does, with the keyboard."""
    for words, wanted in SEARCHES.items():
        page.set_viewport_size(DESKTOP)
        page.goto(home)
        page.keyboard.press("Control+k")
        page.wait_for_function('document.activeElement && document.activeElement.name === "q"')
        page.keyboard.type(words)
        page.keyboard.press("Enter")
        page.wait_for_function('location.pathname.endsWith("search.html")')
        page.wait_for_function('document.querySelector("#search-results h2")?.textContent.includes("Results")')
        results = page.evaluate(RESULTS)
        found.searches += 1
        if not any(wanted.lower() in each.lower() for each in results):
            found.wrong.append(f"search for {words!r} from {home}: {wanted!r} is not among {results[:10]}")
        if shot and words == next(iter(SEARCHES)):
            page.screenshot(path=shot)


def take_pictures(page: Page, site: Path, base: str, folder: Path) -> None:
    """Take pictures of the pages to look at, as wide as a desktop and a phone."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, path in SHOTS.items():
        if not (site / path).is_file():
            continue
        for kind, size in (("desktop", DESKTOP), ("phone", PHONE)):
            page.set_viewport_size(size)
            page.goto(base + path)
            page.screenshot(path=folder / f"{name}-{kind}.png")
            page.screenshot(path=folder / f"{name}-{kind}-whole.png", full_page=True)


def main() -> None:
    """Check a site, print what was seen, and leave with status 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description="Check the documentation site in headless Chromium.")
    parser.add_argument("site", type=Path, help="where it was built")
    parser.add_argument("--out", type=Path, default=Path("out/site-check"), help="where the screenshots go")
    options = parser.parse_args()
    site = options.site.resolve()
    if not (site / "docs" / "index.html").is_file():
        parser.error(f"{options.site}: no site; `make docs` builds it")
    begin = time.monotonic()
    with serve(site) as base, browser() as (page, seen):
        take_pictures(page, site, base, options.out)
        found = check_pages(page, seen, site, base)
        check_search(page, f"{base}docs/index.html", found, options.out / "search-desktop.png")
        check_search(page, (site / "docs" / "index.html").as_uri(), found)  # without any server
    size = sum(path.stat().st_size for path in site.rglob("*") if path.is_file())
    print("\n".join(found.wrong))
    print(
        f"{found.pages} pages, {size / 1e6:.1f} MB, {len(found.links)} internal links, {found.pictures} pictures, "
        f"{found.equations} equations, {found.searches} searches, {len(found.elsewhere)} requests elsewhere; "
        f"{len(found.wrong)} wrong; {time.monotonic() - begin:.0f} s"
    )
    found.wrong += [f"asks for {url}" for url in found.elsewhere]
    sys.exit(1 if found.wrong else 0)


if __name__ == "__main__":
    main()
