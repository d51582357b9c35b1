"""How commands end: one line and an exit status, whatever happens, and names that are shown as they are."""

import io
import os
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchmarks.processes import command
from tensionlab import cli
from tensionlab.cli.common import output
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, RigError
from tensionlab.model.files import load_rig, rig_to_toml
from tests.helpers.scripts import until

RIG = Path(__file__).parents[2] / "datasets" / "rigs" / "bartels2026-validation.toml"
AWKWARD = "[/x] $_$ :x:"
HANG_S = 600.0  # no event takes that long on a machine that is merely busy


FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="no /dev/full")


@pytest.fixture
def run_to(run, monkeypatch):
    """Run `tensionlab` in this process with a stdout, or none: exit status, stderr."""

    def call(stdout, *words):
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stdout", stdout)
            status, out, err = run(*words)
            if stdout is None:
                sys.stdout.close()  # what it wrote to instead
        assert out == ""
        return status, err

    return call


@pytest.mark.parametrize("words", ["", "module", "module config"])
def test_a_command_without_a_verb_prints_its_help_and_has_done_nothing(run, words):
    status, out, err = run(*words.split())
    assert (status, out) == (2, "")
    assert err.startswith(f"Usage: {' '.join(['tensionlab', *words.split()])} [OPTIONS] COMMAND [ARGS]...")


@pytest.mark.parametrize("words", ["solvers", "solvers --json"])
def test_a_reader_that_goes_away_ends_it_without_a_word_and_a_full_disk_with_one_line(run_to, words):
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w", encoding="utf-8") as stdout:
        assert run_to(stdout, *words.split()) == (141, "")
    if FULL.exists():
        with FULL.open("w", encoding="utf-8") as stdout:
            said = "tensionlab: stdout cannot be written (No space left on device)\n"
            assert run_to(stdout, *words.split()) == (2, said)


@pytest.mark.parametrize("closed", ["stdout", "stdout and stderr"])
def test_a_closed_stdout_takes_nothing_and_that_is_that(run_to, monkeypatch, closed):
    if closed != "stdout":
        monkeypatch.setattr(sys, "stderr", None)
    assert run_to(None, "rig", "show", RIG) == (0, "")
    if closed != "stdout":
        sys.stderr.close()


@contextmanager
def process(line, **options):
    """A process beside this one, killed at the end if it still runs."""
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
    with subprocess.Popen(line, **options) as running:
        try:
            yield running
        finally:
            running.kill()


@needs_full
def test_the_interpreter_has_nothing_to_add_at_its_end():
    reader, writer = os.pipe()
    os.close(reader)
    without_stdout = ["bash", "-c", '"$@" >&-', "-"]
    with (
        os.fdopen(writer, "wb") as left,
        FULL.open("wb") as full,
        process(command("solvers", "--json"), stdout=left) as first,
        process(command("solvers", "--json"), stdout=full) as second,
        process([*without_stdout, *command("rig", "show", RIG)]) as third,
    ):
        outcomes = [each.communicate(timeout=HANG_S) for each in (first, second, third)]
        assert [each.returncode for each in (first, second, third)] == [141, 2, 0]
    complaint = "tensionlab: stdout cannot be written (No space left on device)\n"
    assert outcomes == [(None, ""), (None, complaint), ("", "")]


def test_ascii_screens_are_written_to(run_to):
    written = io.BytesIO()
    with io.TextIOWrapper(written, encoding="ascii") as stdout:
        assert run_to(stdout, "solvers") == (0, "")
        assert "\\u2013" in written.getvalue().decode("ascii")


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (KeyboardInterrupt(), 130, f"tensionlab: interrupted: {output.NOTHING_KEPT}"),
        (KeyboardInterrupt("a.zarr is there"), 130, "tensionlab: interrupted: a.zarr is there"),
        (RigError("x.toml: no"), 2, "tensionlab: x.toml: no"),
        (OSError(28, "No space left on device", "/x"), 2, "tensionlab: /x: No space left on device (OSError at"),
        (MemoryError(), 2, "tensionlab: out of memory"),
        (RecursionError("deep"), 2, "tensionlab: nested too deeply"),
        (ValueError("a\n\x1b[31mlong\tone " + 300 * "b"), 2, "tensionlab: a; \\x1b[31mlong one bbb"),
        (RigError("x" * 5000 + "; do that"), 2, "tensionlab: xxx"),
    ],
)
def test_what_goes_wrong_is_one_line(run, monkeypatch, error, status, line):
    def fail(words):
        raise error

    monkeypatch.setattr(cli, "_invoke", fail)
    code, out, err = run("compare")
    assert (code, out) == (status, "")
    assert err.startswith(line)
    assert err.count("\n") == 1
    assert len(err) <= MAX_MESSAGE_CHARACTERS + 1


@pytest.fixture
def awkward(tmp_path):
    """A rig and modules whose names are markup, emoji and mathematics elsewhere."""
    text = rig_to_toml(load_rig(RIG)).replace("floor", AWKWARD).replace('name = "bartels', f'name = "{AWKWARD}')
    path = tmp_path / "awkward.toml"
    path.write_text(text)
    assert AWKWARD in load_rig(path).name
    return path


@pytest.mark.parametrize(
    "words",
    [
        "rig show {rig} --plot {out}.svg",
        "rig check {rig} --plot {out}.svg",
        "allocate {rig} --wrench 0,1,0",
        "compare {rig} --solvers closed-form --directions fibonacci:2 --plot {out}.svg",
        "run {rig} --seconds 0.1",
        "workspace {rig} --box 0,0.1,0.3,0.4,0,0.1 --step 0.05 --metric wrench-closure --plot {out}.svg",
    ],
)
def test_names_are_shown_as_they_are(run, awkward, tmp_path, simulated_time, words):
    code, out, err = run(*words.format(rig=awkward, out=tmp_path / "x").split())
    assert code in (0, 1), err
    assert AWKWARD in out
    picture = tmp_path / "x.svg"
    assert not picture.exists() or AWKWARD in picture.read_text()


def words_of(pid):
    """What a process was called with; nothing if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


@pytest.mark.skipif(sys.platform != "linux", reason="what a process has loaded is listed in /proc")
def test_ctrl_c_ends_a_benchmark_with_one_line(tmp_path):
    with process(command("bench", "--out", tmp_path / "new")) as running:
        until(lambda: "clarabel" in Path(f"/proc/{running.pid}/maps").read_text())  # it has begun to measure
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=HANG_S)
        assert (running.returncode, said) == (130, f"tensionlab: interrupted: {output.NOTHING_KEPT}\n")
