"""How commands end: one line and an exit status, whatever happens, and names that are shown as they are."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tensionlab import cli
from tensionlab.cli.common import output
from tensionlab.errors import MAX_MESSAGE_CHARACTERS, RigError
from tensionlab.model.files import load_rig, rig_to_toml

pytestmark = pytest.mark.realtime  # signals to processes

RIG = Path(__file__).parents[2] / "datasets" / "rigs" / "bartels2026-validation.toml"
AWKWARD = "[/x] $_$ :x:"


def shell(line):
    """Run a line with tensionlab for $T: the exit statuses of its commands, stdout, stderr."""
    script = f"{line}; echo ${{PIPESTATUS[@]}} >&2"
    done = subprocess.run(
        ["bash", "-c", script],
        env=os.environ | {"T": f"{sys.executable} -m tensionlab"},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    *said, statuses = done.stderr.splitlines()
    return [int(status) for status in statuses.split()], done.stdout, said


@pytest.mark.parametrize("words", ["solvers", "solvers --json", f"rig show {RIG} --json"])
def test_a_reader_that_goes_away_ends_it_without_a_word(words):
    statuses, out, said = shell(f"$T {words} | true")
    assert (statuses, out, said) == ([141, 0], "", [])


def test_the_first_line_is_there_for_who_wants_only_that():
    statuses, out, said = shell("$T solvers --json | head -1")
    assert (out, said) == ("{\n", [])
    assert statuses[0] in (0, 141)


@pytest.mark.parametrize("words", ["solvers", "solvers --json"])
def test_a_full_stdout_is_one_line_and_bad(words):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    statuses, _, said = shell(f"$T {words} >/dev/full")
    assert (statuses, said) == ([2], ["tensionlab: stdout cannot be written (No space left on device)"])


@pytest.mark.parametrize("closed", [">&-", ">&- 2>/dev/null"])
def test_a_closed_stdout_takes_nothing_and_that_is_that(closed):
    statuses, out, said = shell(f"$T rig show {RIG} {closed}")
    assert (statuses, out, said) == ([0], "", [])


def test_ascii_screens_are_written_to():
    statuses, _, said = shell("PYTHONIOENCODING=ascii $T solvers")
    assert (statuses, said) == ([0], [])


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (KeyboardInterrupt(), 130, "tensionlab: interrupted"),
        (RigError("x.toml: no"), 2, "tensionlab: x.toml: no"),
        (OSError(28, "No space left on device", "/x"), 2, "tensionlab: /x: No space left on device (OSError at"),
        (MemoryError(), 2, "tensionlab: out of memory"),
        (RecursionError("deep"), 2, "tensionlab: nested too deeply"),
        (ValueError("a\n\x1b[31mlong\tone " + 300 * "b"), 2, "tensionlab: a \\x1b[31mlong one bbb"),
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


def test_a_defect_keeps_its_traceback(run, monkeypatch):
    def fail(words):
        raise TypeError("a defect")

    monkeypatch.setattr(cli, "_invoke", fail)
    with pytest.raises(TypeError):
        cli.main(["compare"])


def test_what_is_typed_wrong_is_not_repeated_at_length(run):
    code, _, err = run("compare", RIG, "--at", "1" * 100_000)
    assert code == 2
    assert len(err) < 500


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
        "workspace {rig} --box 0,0.1,0.3,0.4,0,0.1 --step 0.05 --measure wrench-closure --plot {out}.svg",
    ],
)
def test_names_are_shown_as_they_are(run, awkward, tmp_path, words):
    code, out, err = run(*words.format(rig=awkward, out=tmp_path / "x").split())
    assert code in (0, 1), err
    assert AWKWARD in out
    picture = tmp_path / "x.svg"
    assert not picture.exists() or AWKWARD in picture.read_text()


def test_progress_and_live_tables_show_names_as_they_are(awkward, monkeypatch, capsys):
    from rich.console import Console

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with output.progress("[/x] :x:") as tell:
        tell(0.5)
    screen = output.console()
    assert isinstance(screen, Console)
    with screen.capture() as captured:
        screen.print("[/x] :x:")
    assert captured.get() == "[/x] :x:\n"


def words_of(pid):
    """What a process was called with; nothing if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def heeding_ctrl_c():
    """Let a process be interrupted even where the tests run in the background, which are not."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_ends_a_benchmark_with_one_line_and_its_measuring_process(tmp_path):
    """The terminal sends it to the whole group of processes in the foreground."""
    command = [sys.executable, "-m", "tensionlab", "bench", "--out", str(tmp_path / "new")]
    process = subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heeding_ctrl_c,  # noqa: PLW1509 - no thread runs here
    )
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not children.parent.exists():
        process.kill()
        pytest.skip("children are listed in /proc")
    while not (
        measuring := [pid for pid in children.read_text().split() if "tensionlab.benchmark" in words_of(pid)]
    ):
        assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "tensionlab: interrupted\n")
    while words_of(measuring[0]):  # no longer than to its next sign of life, which nobody hears
        time.sleep(0.05)
