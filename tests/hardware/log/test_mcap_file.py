from contextlib import suppress

import pytest

from tensionlab.errors import LogError
from tensionlab.hardware.log.mcap_file import McapWriter, Record, read_records

SCHEMA = {"title": "number", "type": "object", "properties": {"value": {"type": "number"}}}
FIRST = Record("metadata", "first", {"answer": 42})


@pytest.fixture
def writer(tmp_path):
    writer = McapWriter(tmp_path / "x.mcap", {"numbers": SCHEMA})
    writer.metadata("first", {"answer": 42})
    return writer


def test_half_a_record_is_none(writer, tmp_path):
    """Cut within a number, what is left is a number too."""
    writer.metadata("second", {"value": 123456789})
    writer.flush()
    writer.abandon()
    assert [record.name for record in read_records(tmp_path / "x.mcap")] == ["first", "second"]
    content, cut = (tmp_path / "x.mcap").read_bytes(), tmp_path / "cut.mcap"
    for size in range(len(content) - 9, len(content)):
        cut.write_bytes(content[:size])
        assert list(read_records(cut)) == [FIRST]


@pytest.mark.parametrize("bit", [0x01, 0x80])
def test_whatever_byte_is_damaged_the_rest_is_read_or_left(writer, tmp_path, bit):
    writer.attachment("a", "text/plain", b"abc")
    writer.message("numbers", 10, 20, b'{"value": 1}')
    writer.finish()
    content, damaged = (tmp_path / "x.mcap").read_bytes(), tmp_path / "damaged.mcap"
    *_, message, end = read_records(tmp_path / "x.mcap")
    assert (message, end) == (Record("message", "numbers", b'{"value": 1}', 10), Record("end", "", b""))
    for place in range(len(content)):
        damaged.write_bytes(content[:place] + bytes([content[place] ^ bit]) + content[place + 1 :])
        with suppress(LogError):  # the header is damaged
            list(read_records(damaged))


def test_metadata_nested_too_deep_and_chunks_larger_than_memory_are_damage(writer, tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.hardware.log.mcap_file.MAX_CHUNK_BYTES", 1000)
    writer.message("numbers", 1, 1, b" " * 2000)
    writer.finish()
    assert list(read_records(tmp_path / "x.mcap")) == [FIRST]
    deep = McapWriter(tmp_path / "deep.mcap", {})
    deep.metadata("first", {"answer": 42})
    deep._writer.add_metadata("deep", {"a": "[" * 100_000})
    deep.finish()
    assert list(read_records(tmp_path / "deep.mcap")) == [FIRST]


def test_a_log_whose_chunks_unpack_to_much_in_all_is_refused(writer, tmp_path, monkeypatch):
    monkeypatch.setattr("tensionlab.support.files.reading.FREE_UNPACKED_BYTES", 1_000_000)
    for _ in range(20):
        writer.message("numbers", 1, 1, b" " * 100_000)
        writer.flush()
    writer.finish()
    size = (tmp_path / "x.mcap").stat().st_size
    with pytest.raises(LogError, match=rf"x\.mcap: {size:,} bytes that unpack to more than 1,[\d,]+ are not read"):
        list(read_records(tmp_path / "x.mcap"))
