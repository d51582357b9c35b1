"""The committed figures are the ones that the committed data make, and other data make other figures."""

import re
import runpy
import shutil
import sys
import zlib
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from tensionlab.benchmark import results
from tensionlab.validation.data_tables import write_recording
from tests.helpers.recorded import made_up, made_up_trials

ROOT = Path(__file__).parents[1]
COMMITTED = ROOT / "docs" / "figures"
IMAGES = ROOT / "docs" / "images"
CONSTRAINTS = (ROOT / "constraints.txt").read_text(encoding="utf-8")
pinned = pytest.mark.skipif(
    f"\nmatplotlib=={version('matplotlib')}\n" not in CONSTRAINTS, reason="another matplotlib draws other figures"
)


@pytest.fixture
def make(monkeypatch, capsys):
    """Run `paper_figures/make.py` in this process: exit status, stderr."""
    monkeypatch.syspath_prepend(ROOT / "paper_figures")

    def call(out, *words):
        monkeypatch.setattr(sys, "argv", [str(word) for word in ("make.py", "--out", out, *words)])
        try:
            runpy.run_path(str(ROOT / "paper_figures" / "make.py"), run_name="__main__")
        except SystemExit as left:
            return left.code, capsys.readouterr().err
        return 0, ""

    return call


def content(path):
    """What is in a file, however hard it is compressed."""
    if path.suffix == ".png":
        from matplotlib.image import imread

        return imread(path).tobytes()
    data = path.read_bytes()
    if path.suffix != ".pdf":
        return data
    streams = re.findall(rb"\nstream\n(.*?)\nendstream\n", data, flags=re.DOTALL)
    return [zlib.decompress(each) if each[:1] == b"x" else each for each in streams]


@pinned
@pytest.mark.slow
def test_the_committed_figures_are_up_to_date(tmp_path, make):
    assert make(tmp_path) == (0, "")
    names = {path.name for path in COMMITTED.iterdir()}
    assert {path.name for path in tmp_path.iterdir()} == names
    different = [name for name in sorted(names) if content(tmp_path / name) != content(COMMITTED / name)]
    assert not different, "run `make figures` and look at what changed"


def test_other_data_make_other_figures_and_tables(tmp_path, make):
    data = tmp_path / "datasets"
    shutil.copytree(ROOT / "datasets", data)
    write_recording(data / "recordings" / "paper-like-simulated.parquet", made_up())
    made_up_trials().to_parquet(data / "what-if" / "paper-like-simulated.parquet")
    path = data / "benchmarks" / "results.parquet"
    found = results.read(path)
    found.rows.loc[found.rows["solver"] == "newton", "median_s"] *= 3
    results.write(path.parent, found)
    names = ("forces", "error-sphere", "published", "what-if", "time-accuracy")
    assert make(tmp_path / "out", *names, "--datasets", data) == (0, "")
    files = list((tmp_path / "out").iterdir())
    assert len(files) == 10
    for path in files:
        assert content(path) != content(COMMITTED / path.name), path.name
    table = (tmp_path / "out" / "published.md").read_text(encoding="utf-8")
    assert "20 simulated rigs" in table
    measured = np.linalg.norm(made_up().measured, axis=1).mean()
    assert f"| mean size of the measured force (N) | 1.84 | {measured:.2f} (" in table


def stamped():
    """The stamp of each picture of the documentation, as it is kept and as it would be now."""
    import stamps
    from figures import DRAWINGS
    from pictures import PICTURES

    sources = {
        f"figures/{name}{suffix}": ((*drawing.sources, *stamps.COMMON), "")
        for name, drawing in DRAWINGS.items()
        for suffix in drawing.suffixes
    } | {f"images/{name}": (picture.sources, picture.stamp_text) for name, picture in PICTURES.items()}
    now = {name: stamps.stamp(ROOT / "docs" / name, *made_of) for name, made_of in sources.items()}
    return stamps.read(), now


def test_every_picture_of_the_documentation_is_what_its_code_and_data_draw(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "paper_figures")
    kept, now = stamped()
    files = {f"{each.parent.name}/{each.name}" for folder in (COMMITTED, IMAGES) for each in folder.iterdir()}
    assert now.keys() == files, "each is drawn by a script of paper_figures"
    stale = sorted(name for name in now if kept.get(name) != now[name])
    assert not stale, "`make figures` draws them again; look at them"


def test_a_picture_is_stale_after_a_change_of_code_data_commands_or_itself(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "paper_figures")
    from stamps import stamp

    files = {"drawn.png": "pixels", "draw.py": "x = 1\n", "data/some.toml": "a = 1\n"}
    (tmp_path / "data").mkdir()
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")

    def now(text="tensionlab compare"):
        return stamp(tmp_path / "drawn.png", ("draw.py", "data/*.toml"), text, tmp_path)

    before = now()
    assert now("tensionlab compare --all") != before
    for name, other in (("drawn.png", "others"), ("draw.py", "x = 2\n"), ("data/some.toml", "a = 2\n")):
        (tmp_path / name).write_text(other, encoding="utf-8")
        assert now() != before, name
        (tmp_path / name).write_text(files[name], encoding="utf-8")
    (tmp_path / "draw.py").write_text('"""Draw\n\nthis."""\n\n# why\nx = 1\n', encoding="utf-8")
    assert now() == before  # words do not change what is drawn
    with pytest.raises(FileNotFoundError, match="is called gone"):
        stamp(tmp_path / "drawn.png", ("gone.py",), root=tmp_path)


def test_every_figure_is_described_and_small():
    described = (ROOT / "paper_figures" / "README.md").read_text(encoding="utf-8")
    assert {path.stem for path in COMMITTED.iterdir()} == set(re.findall(r"^\| `(.*?)`", described, re.MULTILINE))
    for path in COMMITTED.iterdir():
        assert path.stat().st_size < 300_000, path.name
    for path in IMAGES.iterdir():
        assert path.stat().st_size <= 700_000, path.name


def test_a_figure_that_is_not_there_is_refused(tmp_path, make):
    status, said = make(tmp_path, "wrkspace")
    assert status == 2
    assert "no figure is called 'wrkspace'; there are forces" in said
    assert not list(tmp_path.iterdir())
