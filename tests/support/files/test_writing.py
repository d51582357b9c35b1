"""Files are written whole or not at all, and nothing but files is replaced."""

import os
import re
from pathlib import Path

import pytest

from tensionlab.errors import WriteError
from tensionlab.support.files import writing

PACKAGE = Path(writing.__file__).parents[2]
# What is written bit by bit in its own place, so that it outlives a killed process; locks; nowhere.
IN_PLACE = {
    "support/files/writing.py",
    "cli/__init__.py",
    "hardware/client/locks.py",
    "validation/protocol.py",
    "workspace/sweep/store.py",
}
WRITES = re.compile(
    r"\.write_(?:text|bytes)\(|\bopen\([^)]*[\"'][rb]*[wxa]|savefig\((?!file)|np\.save\w*\((?!\s*file)|\.to_netcdf\([^e]"
)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_as_a_whole_and_keeps_its_permissions(tmp_path):
    file = tmp_path / "a.txt"
    file.write_text("old")
    file.chmod(0o640)
    with writing.replacing(file) as new:
        new.write(b"new")
        new.flush()
        assert file.read_text() == "old"
    assert file.read_text() == "new"
    assert file.stat().st_mode & 0o777 == 0o640
    assert names(tmp_path) == ["a.txt"]


def test_a_new_file_has_the_permissions_of_any_other(tmp_path):
    writing.write_text(tmp_path / "a.txt", "µ\r\n")
    (tmp_path / "b.txt").touch()
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "b.txt").stat().st_mode
    assert (tmp_path / "a.txt").read_bytes() == "µ\r\n".encode()


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError(), OSError(28, "No space left on device")])
def test_what_fails_leaves_the_old_file_and_no_other(tmp_path, error):
    def fail(new):
        new.write(b"half")
        raise error

    file = tmp_path / "a.txt"
    file.write_text("old")
    with (
        pytest.raises(WriteError if isinstance(error, OSError) else type(error)) as raised,
        writing.replacing(file) as new,
    ):
        fail(new)
    assert file.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]
    if isinstance(error, OSError):
        why = "cannot be written (No space left on device); free some space, or name another place"
        assert str(raised.value) == f"{file}: {why}"


def test_a_link_is_followed_and_stays(tmp_path):
    (tmp_path / "there").mkdir()
    link = tmp_path / "link.txt"
    link.symlink_to(tmp_path / "there" / "a.txt")
    writing.write_text(link, "new")
    assert link.is_symlink()
    assert (tmp_path / "there" / "a.txt").read_text() == "new"


def test_what_is_no_file_is_refused_and_stays(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "null").symlink_to("/dev/null")
    (tmp_path / "round").symlink_to("round")
    for name in (".", "pipe", "null", "round"):
        with pytest.raises(WriteError, match="name a file"):
            writing.require_writable(tmp_path / name)
        with pytest.raises(WriteError, match="name a file"):
            writing.write_text(tmp_path / name, "x")
    assert Path("/dev/null").is_char_device()
    assert (tmp_path / "pipe").is_fifo()
    assert names(tmp_path) == ["null", "pipe", "round"]


def test_a_long_name_is_refused_in_words(tmp_path):
    with pytest.raises(WriteError, match=r"File name too long.*; give a shorter name"):
        writing.require_writable(tmp_path / ("x" * 300))
    longest = tmp_path / ("x" * 251 + ".txt")
    writing.write_text(longest, "fits")
    assert longest.read_text() == "fits"


def test_a_folder_that_is_not_there_is_named_and_none_is_made(tmp_path):
    with pytest.raises(WriteError, match=r"no folder .*none; make it first"):
        writing.require_writable(tmp_path / "none" / "a.txt")
    with pytest.raises(WriteError, match=r"no folder .*none; make it first"):
        writing.require_folder(tmp_path / "none" / "a")
    writing.require_folder(tmp_path / "none" / "a", parents=True)
    writing.require_folder(tmp_path / "a")
    assert names(tmp_path) == []


def test_all_that_the_package_writes_goes_through_this_door():
    found = set()
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8").replace("writing.write_", "").replace("writer.write_", "")
        if WRITES.search(re.sub(r"^ *(>>>|\.\.\.) .*$", "", text, flags=re.MULTILINE)):  # examples may write
            found.add(path.relative_to(PACKAGE).as_posix())
    programs = {name for name in found if "__main__" in (PACKAGE / name).read_text(encoding="utf-8")}
    assert found - programs <= IN_PLACE, "write with tensionlab.support.files.writing"


def test_a_new_file_may_replace_an_empty_one_alone(tmp_path):
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "full.mcap").write_text("a run")
    (tmp_path / "broken.mcap").symlink_to("nowhere")
    for name in ("empty.mcap", "new.mcap"):
        writing.require_new(tmp_path / name, "the log")
    for name in ("full.mcap", "broken.mcap", "."):
        with pytest.raises(WriteError, match="something already; name a new file for the log"):
            writing.require_new(tmp_path / name, "the log")


def test_a_name_needs_more_than_a_suffix(tmp_path):
    for name, words in ((".csv", "a name is missing"), ("a.txt", "unsupported format")):
        with pytest.raises(WriteError, match=rf"{words}; it must end in \.csv or \.parquet"):
            writing.require_writable(tmp_path / name, (".csv", ".parquet"))
