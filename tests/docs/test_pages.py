"""Pages of the documentation say what is: their code and commands run, and print what the pages show.

How a page is written:

- a block of ``python`` is run; the blocks of a page share their names, and a folder of their own;
- a block of ``sh`` holds commands of `tensionlab`, which are run; one that ends with ``# exit status N`` ends so;
- a block of ``text`` right behind either shows what it prints: numbers are compared to 2 %, whole numbers and
  words exactly, and ``...`` stands for any lines or for the rest of one;
- a block whose sentence before ends with the name of a file, as in "`my-room.toml`:", is that file;
- ``<!-- not run: why -->`` before a block leaves it out.

Modules are simulated, in a time of their own: ``modules.toml`` leads to those of the published rig, and after a
block with ``tensionlab serve`` the bridge runs to the end of the page, wherever the page says that it is.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

import tensionlab as tl
from tensionlab.hardware.client.links import modules_to_toml
from tests.helpers.reachable import ReachableRig
from tests.helpers.shown import differences
from tests.helpers.simulated_bridge import SimulatedServe

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    *sorted((DOCS / "concepts").glob("*.md")),
    *sorted((DOCS / "how-to").glob("*.md")),
    DOCS / "get-started" / "index.md",
    DOCS / "index.md",
    DOCS / "which-solver.md",
]
FENCE = re.compile(r"^```(?P<kind>[^\n`]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
NOT_RUN = re.compile(r"<!-- not run: (?P<why>[^>]+) -->\s*$")
FILE = re.compile(r"`(?P<name>[\w./-]+\.\w+)`[^`\n]*:\s*$")
EXIT_STATUS = re.compile(r"#.*\bexit status (\d)")
RUN = ("python", "sh")
WIDEST = 121  # characters of a line of code
each_page = pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(DOCS).as_posix())


class Block(NamedTuple):
    """Block of code of a page: what it holds, what it prints as shown, and what is said before it."""

    kind: str
    text: str
    line: int
    shown: str | None
    file: str | None
    not_run: str | None


def blocks(text: str) -> list[Block]:
    """Return the blocks of a page, in their order."""
    found: list[Block] = []
    end = 0
    for match in FENCE.finditer(text):
        before = text[end : match.start()]
        kind, content = match["kind"].strip(), match["text"]
        if kind == "text" and found and found[-1].kind in RUN and not before.strip():
            found[-1] = found[-1]._replace(shown=content)
        else:
            file, reason = FILE.search(before), NOT_RUN.search(before)
            line = text.count("\n", 0, match.start()) + 1
            found.append(Block(kind, content, line, None, file and file["name"], reason and reason["why"].strip()))
        end = match.end()
    return found


def unlike(shown: str, printed: str) -> list[str]:
    """Lines of what a page shows that are printed otherwise; ``...`` stands for any lines, or the rest of one."""
    lines, printed_lines = shown.strip("\n").split("\n"), printed.strip("\n").split("\n")
    parts: list[list[str]] = [[]]
    for line in lines:
        if line.strip() == "...":
            parts.append([])
        else:
            parts[-1].append(line)
    begin = 0
    for number, part in enumerate(parts):
        last = number == len(parts) - 1
        if number == 0:
            starts = [0]
        elif last:
            starts = [max(begin, len(printed_lines) - len(part))]
        else:
            starts = list(range(begin, len(printed_lines) + 1))
        found = [_differ(part, printed_lines[start : start + len(part)]) for start in starts]
        best = min(range(len(starts)), key=lambda index: (len(found[index]), index), default=0)
        if found[best]:
            return found[best]
        begin = starts[best] + len(part)
    if len(parts) == 1 and begin != len(printed_lines):
        return [f"more is printed: {printed_lines[begin]}"]
    return []


def _differ(shown: list[str], printed: list[str]) -> list[str]:
    if len(shown) != len(printed):
        return [*shown[:1], f"{len(shown)} lines are shown, {len(printed)} printed"]
    wrong = []
    for one, other in zip(shown, printed, strict=True):
        words = other.split()
        if one.endswith("..."):
            words = words[: len(one[:-3].split())]
        if differences(spaced(one.removesuffix("...")), spaced(" ".join(words))):
            wrong.append(f"shown: {one.strip()}   printed: {other.strip()}")
    return wrong


def spaced(line: str) -> str:
    """Return a line with room around brackets and commas, and 1.0 for 1., to compare numbers in arrays.

    A table's rule is as long as its widest row, which times may change: all rules are equal.
    """
    line = re.sub("─+", "─", line)
    return re.sub(r"([\[\](),;:%°])", r" \1 ", re.sub(r"(\d)\.(?!\d)", r"\1.0", line))


def run_commands(text: str) -> str:
    """Run the commands of a block, and return what they print."""
    from tensionlab.cli import main

    out = io.StringIO()
    for line in text.replace("\\\n", " ").strip().split("\n"):
        words = shlex.split(line, comments=True)
        assert words[0] == "tensionlab", f"no command of tensionlab: {line}"
        expected = EXIT_STATUS.search(line)
        said = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said), pytest.raises(SystemExit) as left:
            main(words[1:])
        assert (left.value.code or 0) == (int(expected[1]) if expected else 0), f"{line}\n{said.getvalue()}"
    return out.getvalue()


def run_code(text: str, names: dict[str, object], where: str) -> str:
    """Run the code of a block, and return what it prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(text, where, "exec"), names)
    return out.getvalue()


def modules_in(text: str) -> list[str]:
    """Return the names in a modules file."""
    return list(tomllib.loads(text)["modules"])


class Page:
    """Page that is followed: its names, and the bridge once it is served."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
        self.names: dict[str, object] = {"__name__": "page"}
        self._monkeypatch, self._name = monkeypatch, name
        self.bridge: SimulatedServe | None = None

    def run(self, block: Block) -> str:
        """Run a block, and return what it prints."""
        if block.kind == "sh" and block.text.startswith("tensionlab serve "):
            words = shlex.split(block.text)[2:]
            with contextlib.redirect_stdout(io.StringIO()) as out:
                self.bridge = SimulatedServe((*words, "--port", 0), self._monkeypatch)
                self.bridge.sleep(0.01)  # it goes on to say where it is
            self._monkeypatch.setattr("time.sleep", self.bridge.sleep)
            return out.getvalue().replace(self.bridge.url.rpartition(":")[2], "8765")
        if block.kind == "sh":
            return run_commands(block.text)
        text = "\n" * block.line + block.text
        if self.bridge is not None:
            text = text.replace("ws://127.0.0.1:8765", self.bridge.url)
        return run_code(text, self.names, self._name)


@pytest.fixture
def page(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, simulated_time: object
) -> Iterator[Page]:
    """A page to follow in an empty folder, with simulated modules."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("COLUMNS", "110")
    modules = ReachableRig(monkeypatch, tl.load_rig("bartels2026-validation"))
    (tmp_path / "modules.toml").write_text(modules_to_toml(modules.urls), encoding="utf-8")
    followed = Page(monkeypatch, request.node.name)
    yield followed
    if followed.bridge is not None:
        with followed.bridge:
            pass
    for name, module in list(sys.modules.items()):
        if str(tmp_path) in str(getattr(module, "__file__", None)):
            del sys.modules[name]


@each_page
def test_its_code_and_commands_run_and_print_what_it_shows(path: Path, page: Page) -> None:
    for block in blocks(path.read_text(encoding="utf-8")):
        if block.file == "modules.toml":
            assert modules_in(block.text) == modules_in(Path(block.file).read_text(encoding="utf-8"))
        elif block.file is not None:
            Path(block.file).parent.mkdir(parents=True, exist_ok=True)
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif block.kind in RUN and block.not_run is None:
            printed = page.run(block)
            if block.shown is not None:
                assert not unlike(block.shown, printed), f"{path.name}:{block.line} prints:\n{printed}"


@each_page
def test_its_pictures_exist_and_are_described(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for block in blocks(text):
        if block.kind.startswith("{figure}"):
            picture = block.kind.removeprefix("{figure}").strip()
            assert (path.parent / picture).is_file(), picture
            (words,) = re.findall(r"^:alt: (.+)$", block.text, re.MULTILINE)
            assert len(words) > 20, picture
    for words, picture in re.findall(r"!\[(.*?)\]\((.*?)\)", text):
        assert (path.parent / picture).is_file(), picture
        assert len(words) > 20, picture


@each_page
def test_its_code_fits_between_the_sidebars(path: Path) -> None:
    """Of the site, on a screen of 1400 pixels; `make docs-check` measures every page in a browser."""
    for block in blocks(path.read_text(encoding="utf-8")):
        if not block.kind.startswith("{"):
            lines = [*block.text.splitlines(), *(block.shown or "").splitlines()]
            assert not [line for line in lines if len(line) > WIDEST], f"{path.name}:{block.line}"


@pytest.mark.parametrize("path", [*PAGES, DOCS / "glossary.md"], ids=lambda path: path.stem)
def test_its_links_lead_somewhere(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for name, anchor in re.findall(r"\]\(([\w./-]*)(#[\w-]+)?\)", text):
        target = path.parent / name if name else path
        assert target.exists(), name
        if anchor and target.suffix == ".md":
            headings = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor[1:] in {slug(each) for each in headings}, f"{name}{anchor}"


def slug(heading: str) -> str:
    """Return the anchor of a heading, as GitHub and MyST make it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def test_the_glossary_is_in_order() -> None:
    text = (DOCS / "glossary.md").read_text(encoding="utf-8")
    entries = re.findall(r"^:::\{glossary\}\n(.*?)^:::$", text, re.MULTILINE | re.DOTALL)
    terms = [line for part in entries for line in part.splitlines() if line and not line.startswith(" ")]
    assert len(terms) > 40
    assert terms == sorted(terms, key=str.lower)


def test_there_are_pages() -> None:
    assert {"solvers", "infeasible-wrenches", "protocol"} <= {path.stem for path in PAGES}


def test_blocks_know_their_output_their_file_and_why_they_are_not_run() -> None:
    text = "a\n```python\nprint(1)\n```\n\n```text\n1\n```\nSave this as `x.toml`:\n\n```toml\na = 1\n```\n"
    code, file = blocks(text + "<!-- not run: no hardware -->\n```sh\ntensionlab estop\n```\n")[:2]
    assert (code.kind, code.shown, code.file) == ("python", "1\n", None)
    assert (file.file, file.shown) == ("x.toml", None)
    assert blocks("<!-- not run: no hardware -->\n```sh\nx\n```\n")[0].not_run == "no hardware"


def test_what_a_page_shows_otherwise_is_seen() -> None:
    assert not unlike("a 1.00 N\n...\nz", "a 1.001 N\nb\nc\nz")
    assert not unlike("[0.5, 1.0]\nb ...", "[0.5, 1.0]\nb c d")
    assert not unlike("───", "─────")
    assert unlike("a 1.00 N", "a 1.10 N")
    assert unlike("a", "a\nb")
    assert unlike("a\n...\ny", "a\nb\nz")
    assert unlike("182 EXACT", "181 EXACT")


@pytest.mark.parametrize("folder", ["concepts", "how-to"])
def test_every_page_is_in_the_index_of_its_folder(folder: str) -> None:
    index = (DOCS / folder / "index.md").read_text(encoding="utf-8")
    for path in sorted((DOCS / folder).glob("*.md")):
        if path.stem != "index":
            assert f"]({path.name})" in index, path.name
            assert re.search(rf"^{path.stem}$", index, re.MULTILINE), path.name
