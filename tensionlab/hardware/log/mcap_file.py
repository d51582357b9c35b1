"""MCAP files, which logs of runs are written to and read from. The only importer of mcap and zstandard."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, NamedTuple

from tensionlab.errors import LogError, optional_import
from tensionlab.support.files import writing
from tensionlab.support.files.reading import parse_json, require_unpackable

PROFILE = "tensionlab-run-1"  # mark of a log and its version in the header of a file
MAX_CHUNK_BYTES = 16_000_000  # largest unpacked chunk: its messages take many times the memory; logs have 1 MB
PROGRESS_MESSAGES = 1000  # number of messages read between two calls of `progress`


class McapWriter:
    """Writer of a log: metadata, attachments, then messages in JSON, whose schemas are given by channel.

    Messages are gathered in chunks, compressed, and indexed at the end, so that Foxglove can seek in a long run. A
    chunk ends with `flush`; what follows the last one is lost if the process is killed. A `WriteError` if there is
    something in the file already; an `OSError`, here and in all methods, if the system can't write.
    """

    def __init__(self, path: Path, schemas: Mapping[str, Mapping[str, Any]]) -> None:
        with optional_import("hardware", "the log of a run"):
            from mcap.writer import Writer
        writing.require_new(path, "the log")
        self._file = writing.open_stream(path)
        self._writer = Writer(self._file)
        self._writer.start(profile=PROFILE, library="tensionlab")
        self._channels = {}
        for topic, schema in schemas.items():
            number = self._writer.register_schema(schema["title"], "jsonschema", json.dumps(schema).encode())
            self._channels[topic] = self._writer.register_channel(topic, "json", number)

    def metadata(self, name: str, values: Mapping[str, Any]) -> None:
        """Add values under a name, each written in JSON."""
        self._writer.add_metadata(name, {key: json.dumps(value, default=str) for key, value in values.items()})

    def attachment(self, name: str, media_type: str, content: bytes) -> None:
        """Add a file within the file."""
        self._writer.add_attachment(0, 0, name, media_type, content)

    def message(self, topic: str, time_ns: int, written_ns: int, content: bytes) -> None:
        """Add a message of a channel: the time of its content, and of its handing over, in ns since 1970."""
        self._writer.add_message(self._channels[topic], time_ns, content, written_ns)

    def flush(self) -> None:
        """Write all that was added to the file."""
        self._writer.flush()

    def finish(self) -> None:
        """Write the index, which marks the file as complete, and close it."""
        self._writer.finish()
        self._file.close()

    def abandon(self) -> None:
        """Close the file as it is, incomplete."""
        with suppress(OSError):
            self._file.close()


class Record(NamedTuple):
    """Record of a log: "metadata" (a dict), "attachment" or "message" (bytes); complete logs have an "end"."""

    kind: str
    name: str  # of the metadata or the attachment; channel of a message
    content: Any
    time_ns: int = 0  # time of a message's content, in ns since 1970


class _UnpackedLogError(LogError):
    """The chunks of a file unpack to more than its limit."""


def read_records(path: Path, progress: Callable[[float], None] | None = None) -> Iterator[Record]:
    """Yield the records of a log that are whole, up to the first that is not.

    ``progress`` is called with the share of the file that has been read. A `LogError` if it can't be read, or is
    no log of a run.
    """
    with optional_import("hardware", "the log of a run"):
        from mcap.records import Attachment, Channel, Footer, Header, Message, Metadata
    channels: dict[int, str] = {}
    known = complete = False
    messages = 0
    with _open(path) as file:
        size = os.fstat(file.fileno()).st_size
        whole = _whole_records(file, size, str(path))
        while True:
            decoded = None
            try:
                record = next(whole, None)
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                elif isinstance(record, Metadata):
                    values = {key: parse_json(text, key, LogError) for key, text in record.metadata.items()}
                    decoded = Record("metadata", record.name, values)
                elif isinstance(record, Attachment):
                    decoded = Record("attachment", record.name, record.data)
                elif isinstance(record, Message):
                    decoded = Record("message", channels[record.channel_id], record.data, record.log_time)
            except _UnpackedLogError:
                raise
            except Exception:  # whatever a decoder raises over damaged bytes: what came before counts
                complete = False
                break
            if isinstance(record, Header):
                known = record.profile == PROFILE
            if record is None or not known:
                break
            complete |= isinstance(record, Footer)
            if decoded is not None:
                messages += decoded.kind == "message"
                if progress is not None and decoded.kind == "message" and messages % PROGRESS_MESSAGES == 0:
                    progress(file.tell() / size)
                yield decoded
    if not known:
        raise LogError(f"{path}: not the log of a run; give a file that `tensionlab run --log` wrote")
    if complete:
        yield Record("end", "", b"")


def _whole_records(file: IO[bytes], size: int, source: str) -> Iterator[Any]:
    """Yield the records of a file, those in its chunks too, as mcap has them."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk
    from zstandard import frame_content_size

    total = 0
    for record in StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=size).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        packed = frame_content_size(record.data) if record.compression == "zstd" else len(record.data)
        unpacked = max(packed, record.uncompressed_size)
        if record.compression not in ("zstd", "") or not 0 <= unpacked <= MAX_CHUNK_BYTES:
            raise EOFError
        total += unpacked
        require_unpackable(total, size, source, _UnpackedLogError)
        yield from breakup_chunk(record, validate_crc=True)


def _open(path: Path) -> IO[bytes]:
    try:
        return path.open("rb")
    except OSError as error:
        why = "is a folder" if isinstance(error, IsADirectoryError) else f"cannot be read ({error.strerror})"
        raise LogError(f"{path}: {why}; give the log of a run (*.mcap)") from None
