from contextlib import suppress

import pytest

from tensionlab.errors import LogError
from tensionlab.hardware.log.mcap_file import McapWriter, Record, read_records

SCHEMA = {"title": "number", "type": "object", "properties": {"value": {"type": "number"}}}


def test_half_a_record_is_none(tmp_path):
    """Cut within a number, what is left is a number too."""
    file, cut = tmp_path / "whole.mcap", tmp_path / "cut.mcap"
    writer = McapWriter(file, {"numbers": SCHEMA})
    writer.metadata("first", {"answer": 42})
    writer.metadata("second", {"value": 123456789})
    writer.flush()
    writer.abandon()
    first, second = Record("metadata", "first", {"answer": 42}), Record("metadata", "second", {"value": 123456789})
    assert list(read_records(file)) == [first, second]
    content = file.read_bytes()
    for size in range(len(content) - 9, len(content)):
        cut.write_bytes(content[:size])
        assert list(read_records(cut)) == [first]


@pytest.mark.parametrize("bit", [0x01, 0x80])
def test_whatever_byte_is_damaged_the_rest_is_read_or_left(tmp_path, bit):
    file, damaged = tmp_path / "whole.mcap", tmp_path / "damaged.mcap"
    writer = McapWriter(file, {"numbers": SCHEMA})
    writer.attachment("a", "text/plain", b"abc")
    writer.metadata("first", {"answer": 42})
    writer.message("numbers", 10, 20, b'{"value": 1}')
    writer.finish()
    content = file.read_bytes()
    *_, message, end = read_records(file)
    assert (message, end) == (Record("message", "numbers", b'{"value": 1}', 10), Record("end", "", b""))
    for place in range(len(content)):
        damaged.write_bytes(content[:place] + bytes([content[place] ^ bit]) + content[place + 1 :])
        with suppress(LogError):  # the header is damaged
            list(read_records(damaged))
