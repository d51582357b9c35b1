"""Every verb that writes, on every kind of place that cannot be written.

The verbs are found in the program itself: an option that writes and has no recipe here fails a test.
"""

import builtins
import errno
import inspect
import io
import logging
import os
import re
import signal
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tensionlab.benchmark import experiment as bench
from tensionlab.benchmark import results
from tensionlab.hardware.client.group import ModuleGroup
from tensionlab.hardware.simulation import serve as serving
from tensionlab.model.files import load_rig
from tensionlab.support.files import writing
from tensionlab.support.files.tables import table_text
from tests.helpers import runs
from tests.helpers.verbs import every_verb

resource = pytest.importorskip("resource", reason="limits of a process stand for the disk's")

RIGS = Path(__file__).parents[2] / "datasets" / "rigs"
RIG = RIGS / "bartels2026-validation.toml"
CUBE = RIGS / "cube-8.toml"
SUBMISSION = RIGS.parents[1] / "benchmarks" / "submissions" / "newton"
SPACE = Path(__file__).parents[1] / "data" / "flat_space.toml"
COMPARE = f"compare {RIG} --solvers closed-form --directions fibonacci:2"
SWEEP = f"workspace {RIG} --box 0,0.1,0.3,0.3,0,0.1 --step 0.1 --metric wrench-closure"
PROOF = f"certify {RIG} --box 0,0.1,0.3,0.4,0,0.1 --step 0.05"
PLAYED = "scenario materials --seconds 0.2"
RECIPES = {
    ("compare", "--plot"): (COMPARE, ".png"),
    ("compare", "--out"): (COMPARE, ".parquet"),
    ("workspace", "--out"): (SWEEP, ".zarr"),
    ("workspace", "--plot"): (SWEEP, ".png"),
    ("trajectory", "--plot"): (f"trajectory {RIGS / 'kntu-planar.toml'} path.csv --solvers newton", ".png"),
    ("certify", "--out"): (PROOF, ".npz"),
    ("certify", "--plot"): (PROOF, ".png"),
    ("bench", "--out"): ("bench --set edge --solvers closed-form", ""),
    ("bench submit", "--out"): (f"bench submit {SUBMISSION}", ".md"),
    ("run", "--log"): (f"run {RIG} --seconds 0.3", ".mcap"),
    ("scenario", "--log"): (PLAYED, ".mcap"),
    ("scenario", "--plot"): (PLAYED, ".svg"),
    ("serve", "--log"): (f"serve {RIG} --seconds 0.3 --port 0", ".mcap"),
    ("simulate", "--modules"): (f"simulate {RIG}", ".toml"),
    ("validate", "--out"): (f"validate {RIG} --preset ideal --hold 0.35", ""),
    ("validate", "--plot"): (f"validate {RIG} --preset ideal --hold 0.35 --out validation", ".png"),
    ("characterise", "--out"): (f"characterise {RIG}", ""),
    ("module calibrate record", "--out"): (f"module calibrate record {RIG} --modules modules.toml", ".csv"),
    ("module calibrate anchors", "--out"): (f"module calibrate anchors {RIG} lengths.csv --known", ".toml"),
    ("rig show", "--plot"): (f"rig show {RIG}", ".pdf"),
    ("rig check", "--plot"): (f"rig check {CUBE}", ".png"),
    ("rig import", "--out"): ("rig import --caspr bodies.xml cables.xml", ".toml"),
    ("rig export", "--out"): (f"rig export {CUBE}", ".xml"),
    ("layout search", "--out"): ("layout search space.toml", ".toml"),
    ("layout search", "--plot"): ("layout search space.toml", ".png"),
    ("new", "--out"): ("new rig", ".toml"),
    ("log export", "--out"): ("log export run.mcap", ".nc"),
    ("log plot", "--plot"): ("log plot run.mcap", ".png"),
    ("problems", "--out"): ("problems edge --count 2", ".parquet"),
}
"""What makes each option write something, and the suffix of its file; none for a folder."""
# What is written bit by bit under its own name, so that it outlives the process.
IN_PLACE = {".mcap", ".csv", ".zarr"}
READS = {"token_file", "rig", "rigs", "path", "poses", "trajectory", "program", "modules", "scenario", "sensor",
         "caspr", "measured", "old", "new", "folder"}  # fmt: skip
QUICK = [key for key in RECIPES if key[0] not in ("validate", "characterise")]


def parameters():
    """All parameters of all verbs: words of the verb, the parameter, and how it is annotated."""
    for words, command in every_verb():
        annotations = inspect.unwrap(command.callback).__annotations__
        yield from ((words, each, str(annotations.get(each.name, ""))) for each in command.params)


def writes(parameter):
    """Whether a parameter is checked as one that names a file or a folder to write."""
    callback = parameter.callback
    while hasattr(callback, "__wrapped__"):
        callback = callback.__wrapped__
    name = getattr(callback, "__qualname__", "")
    return name.startswith("checked.")


def test_every_option_that_writes_is_tried_here_and_every_path_is_known():
    found = {(verb, each.opts[0]) for verb, each, _ in parameters() if writes(each)}
    assert found == set(RECIPES)
    unknown = {
        (verb, each.name)
        for verb, each, annotation in parameters()
        if re.search(r"\bPath|ModulesFile|RigFile|RunFile", annotation)
        and not writes(each)
        and each.name not in READS
    }
    assert not unknown, "an option that writes needs `writes` or `writes_folder`"


@pytest.fixture(scope="module")
def prepared(tmp_path_factory, bench_results):
    """A folder with what the verbs read."""
    import matplotlib.font_manager  # noqa: F401 - its cache is written now, not where a disk is full

    folder = tmp_path_factory.mktemp("prepared")
    rig = load_rig(RIG)
    (folder / "path.csv").write_text("t,x,y\n0,0,0\n0.5,0,0.1\n1,0,0.2\n")
    (folder / "space.toml").write_text(SPACE.read_text())
    names = "\n".join(f'"{module.name}" = "sim:"' for module in rig.modules[:1])
    (folder / "modules.toml").write_text(f"[modules]\n{names}\n")
    places = rig.home + np.random.default_rng(1).uniform([-0.3, 0.0, -0.3], [0.3, 1.2, 0.3], (8, 3))
    lengths = {module.name: column for module, column in zip(rig.modules, rig.lengths(places).T, strict=True)}
    (folder / "lengths.csv").write_text(table_text({**dict(zip("xyz", places.T, strict=True)), **lengths}))
    runs.logged(folder / "run.mcap", runs.four(), 20)
    (folder / "measured").mkdir()
    results.write(folder / "measured", bench_results)
    return folder


@pytest.fixture
def quick(monkeypatch):
    """Leave out what takes long, wants hardware or never ends; all that writes is real."""
    from tensionlab.cli import module_calibrate
    from tensionlab.hardware.calibration import lengths
    from tensionlab.interop import caspr

    make = bench.plan

    def brief(*words):
        return replace(make(*words), count=2, seconds=0.01, repeats=1)

    @contextmanager
    def nobody(*_):
        yield ModuleGroup([])

    monkeypatch.setattr(bench, "plan", brief)
    monkeypatch.setattr(serving, "serve", lambda server, stopped: server.close())
    monkeypatch.setattr(module_calibrate, "_group", nobody)
    monkeypatch.setattr(lengths, "record_lengths", lambda *_: np.ones((3, 4)))
    monkeypatch.setattr(caspr, "load_caspr", lambda *_: load_rig(RIG))
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def place(tmp_path, prepared, monkeypatch):
    """A folder to write to; the working directory has what is read."""
    monkeypatch.chdir(prepared)
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


@contextmanager
def refusing(monkeypatch, folder, number):
    """The system lets nobody write to a folder: permissions do not stop who runs as root."""

    def guarded(function, writes):
        def call(path, *words, **options):
            if (
                isinstance(path, (str, os.PathLike))
                and str(path).startswith(str(folder))
                and writes(words, options)
            ):
                raise OSError(number, os.strerror(number), str(path))
            return function(path, *words, **options)

        return call

    with monkeypatch.context() as patched:
        opened = guarded(io.open, lambda words, options: set("wxa+") & set((*words, options.get("mode", "r"))[0]))
        patched.setattr(io, "open", opened)
        patched.setattr(builtins, "open", opened)
        patched.setattr(os, "mkdir", guarded(os.mkdir, lambda words, options: True))
        yield


def invoke(run, key, target):
    command = RECIPES[key][0]
    code, out, err = run(*command.split(), key[1], target)
    lines = [line for line in err.splitlines() if line.startswith(("tensionlab:", "Error:"))]
    assert all(len(line) <= 300 for line in lines), lines
    assert "Traceback" not in err
    return code, out, lines


@pytest.mark.parametrize("key", RECIPES, ids=" ".join)
def test_what_cannot_be_written_is_refused_before_the_work(run, place, quick, monkeypatch, key):
    suffix = RECIPES[key][1]
    folder = suffix in ("", ".zarr")
    target = place / f"x{suffix}"
    cases = {"a file in the place of a folder": place / "file" / f"x{suffix}"}
    (place / "file").write_text("precious")
    if folder:
        target.mkdir()
        cases |= {"a file": place / f"file{suffix}"} if not suffix else {}
    else:
        target.write_text("precious")
        (place / f"folder{suffix}").mkdir()
        os.mkfifo(place / f"pipe{suffix}")
        (place / f"null{suffix}").symlink_to("/dev/null")
        cases |= {
            "no folder": place / "none" / f"x{suffix}",
            "a folder": place / f"folder{suffix}",
            "a pipe": place / f"pipe{suffix}",
            "a device": place / f"null{suffix}",
            "another suffix": place / "x.docx",
        }
        cases |= {"a log that is there": target} if suffix == ".mcap" else {}
    for what, at in cases.items():
        code, _, lines = invoke(run, key, at)
        assert (code, len(lines)) == (2, 1), what
        assert at.name in lines[0] or at.parent.name in lines[0], (what, lines)
        assert at != target or "x.mcap: there is something already; name a new file" in lines[0]
    for number in (errno.EROFS, errno.EACCES, errno.ENOSPC):
        with refusing(monkeypatch, place, number):
            code, _, lines = invoke(run, key, target)
        assert (code, len(lines)) == (2, 1), lines
        assert os.strerror(number) in lines[0]
    assert Path("/dev/null").is_char_device()
    assert (place / "file").read_text() == "precious"
    assert folder or target.read_text() == "precious"
    assert not list(place.glob(".tensionlab-*"))


@pytest.mark.parametrize("key", QUICK, ids=" ".join)
def test_what_fails_after_the_work_is_said_and_spoils_nothing(run, place, quick, monkeypatch, key):
    suffix = RECIPES[key][1]
    target = place / f"x{suffix}"
    if suffix and suffix not in IN_PLACE:
        target.write_text("precious")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    monkeypatch.setattr(logging, "raiseExceptions", False)  # what is captured goes to a file, which is full too

    def then(check):
        def call(*words, **options):
            check(*words, **options)
            resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))

        return call

    monkeypatch.setattr(writing, "require_writable", then(writing.require_writable))
    monkeypatch.setattr(writing, "require_folder", then(writing.require_folder))
    try:
        code, _, lines = invoke(run, key, target)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert code in (1, 2)
    assert lines
    if suffix not in IN_PLACE:
        assert not suffix or target.read_text() == "precious"
        assert not list(place.rglob(".tensionlab-*"))
        assert all(path.stat().st_size for path in place.rglob("*") if path.is_file())
