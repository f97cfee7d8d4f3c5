"""Export of a log's topics to tables: one Parquet or CSV file for each topic."""

from __future__ import annotations

import fnmatch
import json
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self
from zlib import crc32

from bridge.convert.table_names import table_names
from bridge.errors import BridgeError, OutputExistsError
from bridge.record.decode.blocks import BLOCK_BYTES, blocks
from bridge.record.decode.forms import Form, Opaque
from bridge.record.decode.protobuf_form import ProtobufForm
from bridge.record.decode.ros_form import RosForm
from bridge.record.errors import LogWriteError
from bridge.record.family import parts_of
from bridge.record.file_summary import read_file_summary
from bridge.record.mcap_records import Declared
from bridge.record.names import readable_name
from bridge.record.scan import first_end, opened

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from concurrent.futures import Future
    from pathlib import Path

    from bridge.convert.tables import TableWriter
    from bridge.record.decode.blocks import Block

_MAX_THREADS = 4


class ExportMissingError(BridgeError):
    """pyarrow is not installed."""

    def __init__(self) -> None:
        super().__init__("export needs pyarrow: pip install 'sweepctl[export]'")


class NoSuchTopicError(BridgeError):
    """The log has no topic that matches a pattern."""

    exit_status = 2

    def __init__(self, wanted: str, topics: Sequence[str]) -> None:
        super().__init__(f"no topic matches {wanted!r}; the log has: {', '.join(topics) or 'none'}")
        self.wanted = wanted


@dataclass(slots=True)
class Exported:
    """Result of an export."""

    files: dict[str, Path] = field(default_factory=dict)
    """Map of each topic to its written file."""
    rows: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    """Damage that was skipped, and messages that could not be decoded."""

    @property
    def messages(self) -> int:
        """Number of messages of all topics."""
        return sum(self.rows.values())


def export(  # noqa: PLR0913 - the options of an export
    path: Path,
    out: Path,
    *,
    file_format: str = "parquet",
    topics: Sequence[str] = (),
    force: bool = False,
    block_bytes: int = BLOCK_BYTES,
) -> Exported:
    """Write a log's topics to tables in a folder.

    Each table has ``log_time`` and ``publish_time`` (UTC, ns), ``sequence`` and a column for every
    field. Fields of nested messages have names with dots.

    Args:
        path: The log.
        out: Folder for the tables; created if missing.
        file_format: ``parquet`` or ``csv``.
        topics: Patterns of topics; empty: all topics.
        force: Replace existing files.
        block_bytes: Amount of data that is read at once, bytes.

    Raises:
        LogReadError: the log is missing, cannot be read, or is not an MCAP file.
        OutputExistsError: a file exists, and ``force`` is False.
        LogWriteError: the folder or a file cannot be written.
        NoSuchTopicError: a pattern matches no topic.
        ExportMissingError: pyarrow is not installed.

    """
    try:
        import pyarrow as pa  # noqa: F401, PLC0415 - an optional dependency, slow to import
    except ImportError:
        raise ExportMissingError from None
    parts = parts_of(path)
    _check_patterns(parts, topics)
    result = Exported()
    work = _Exporter(path, out, file_format, topics, result, force=force)
    try:
        with work:
            work.plan(topic for part in parts for topic in _topics_with_messages(part))
            work.check_free()
            for part in parts:
                for block in blocks(part, work.begin(), result.problems, block_bytes):
                    work.take(block)
                work.finish()
    except OSError as error:
        if isinstance(error, BridgeError):
            raise
        raise LogWriteError.of(out, error) from None
    return result


def _check_patterns(parts: Sequence[Path], patterns: Sequence[str]) -> None:
    """Check that every pattern matches a topic, before anything is written.

    Raises:
        LogReadError: a file is missing, cannot be read, or is not an MCAP file.
        NoSuchTopicError: a pattern matches no topic.

    """
    topics = {name for part in parts for name in _declared_topics(part)} if patterns else set()
    if all(fnmatch.filter(topics, pattern) for pattern in patterns):
        return
    for part in parts:  # a summary may be incomplete or missing
        declared = Declared()
        for _ in blocks(part, declared, []):
            pass
        topics |= {channel.topic for channel in declared.channels.values()}
    for pattern in patterns:
        if not fnmatch.filter(topics, pattern):
            raise NoSuchTopicError(pattern, sorted(topics))


def _declared_topics(part: Path) -> list[str]:
    """Return the topics that a file's summary declares."""
    with opened(part) as data:
        declared = read_file_summary(data, 0, first_end(data)[0]).declared
        return [channel.topic for channel in declared.channels.values()]


def _topics_with_messages(part: Path) -> set[str]:
    """Return the topics with messages. They are from the summary if it is valid."""
    with opened(part) as data:
        end, is_whole = first_end(data)
        summary = read_file_summary(data, 0, end)
    if is_whole and summary.is_proven and summary.counts is not None:
        channels = summary.declared.channels
        return {channels[c].topic for c, n in summary.counts.items() if n and c in channels}
    declared, found = Declared(), set[int]()
    for block in blocks(part, declared, []):
        found.update(block.starts)
    return {declared.channels[c].topic for c in found if c in declared.channels}


class _Exporter:
    def __init__(  # noqa: PLR0913 - the options and the result of an export
        self,
        path: Path,
        out: Path,
        file_format: str,
        topics: Sequence[str],
        result: Exported,
        *,
        force: bool,
    ) -> None:
        self.declared = Declared()
        self._path, self._out, self._format = path, out, file_format
        self._patterns, self._result, self._force = topics, result, force
        self._tables: dict[str, Path] = {}
        self._writers: dict[str, TableWriter] = {}
        self._forms: dict[int, Form] = {}
        self._unknown: set[int] = set()
        self._started: list[tuple[str, Future[int]]] = []
        # One thread per file; Arrow releases the interpreter's lock.
        self._pool = ThreadPoolExecutor(min(_MAX_THREADS, os.cpu_count() or 1))

    def plan(self, topics: Iterable[str]) -> None:
        """Assign a file to every topic."""
        names = table_names({topic for topic in topics if self._wanted(topic)})
        for topic, name in names.items():
            self._tables[topic] = self._out / f"{name}.{self._format}"

    def check_free(self, files: Iterable[Path] | None = None) -> None:
        """Check that no file would be replaced without ``force``.

        Raises:
            OutputExistsError: a file exists.

        """
        for file in self._tables.values() if files is None else files:
            if not self._force and os.path.lexists(file):
                raise OutputExistsError(file)

    def begin(self) -> Declared:
        """Start a file of the run. Each file has its own channel ids."""
        self.declared, self._forms, self._unknown = Declared(), {}, set()
        return self.declared

    def take(self, block: Block) -> None:
        """Start to write a block's messages after the last block is finished."""
        self.finish()
        by_topic: dict[str, list[int]] = {}
        for channel_id in block.starts:
            channel = self.declared.channels.get(channel_id)
            if channel is not None:
                by_topic.setdefault(channel.topic, []).append(channel_id)
            elif channel_id not in self._unknown:
                self._unknown.add(channel_id)
                self._result.problems.append(f"channel {channel_id} has no declaration")
        sizes = {
            topic: sum(int(block.lengths[channel_id].sum()) for channel_id in channel_ids)
            for topic, channel_ids in by_topic.items()
            if self._wanted(topic)
        }
        for topic in sorted(sizes, key=lambda topic: -sizes[topic]):  # largest first
            channel_ids = by_topic[topic]
            writer = self._writers.get(topic) or self._open(topic, channel_ids[0])
            parts = [(channel_id, self._form(channel_id)) for channel_id in channel_ids]
            self._started.append((topic, self._pool.submit(writer.write, block, parts)))
            count = sum(len(block.starts[channel_id]) for channel_id in channel_ids)
            self._result.rows[topic] = self._result.rows.get(topic, 0) + count

    def finish(self) -> None:
        """Wait for all started writes.

        Raises:
            OSError: a file cannot be written.

        """
        started, self._started = self._started, []
        for topic, writing in started:
            bad = writing.result()
            if bad:
                self._result.problems.append(f"{topic}: {bad} messages could not be decoded")

    def _wanted(self, topic: str) -> bool:
        return not self._patterns or any(fnmatch.fnmatchcase(topic, p) for p in self._patterns)

    def _form(self, channel_id: int) -> Form:
        form = self._forms.get(channel_id)
        if form is None:
            form = self._forms[channel_id] = _form(self.declared, channel_id)
        return form

    def _open(self, topic: str, channel_id: int) -> TableWriter:
        from bridge.convert.tables import TableWriter  # noqa: PLC0415 - imports pyarrow

        try:
            self._out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LogWriteError.of(self._out, error) from None
        file = self._tables.get(topic)
        if file is None:  # the summary has no messages for it
            name = f"{table_names([topic])[topic]}~{crc32(topic.encode()):08x}"
            file = self._tables[topic] = self._out / f"{name}.{self._format}"
            self.check_free([file])
        channel = self.declared.channels[channel_id]
        schema = self.declared.schemas.get(channel.schema_id)
        notes = {
            "topic": topic,
            "schema": schema.name if schema else "",
            "log": readable_name(self._path.name),
        }
        try:
            writer = TableWriter(file, self._form(channel_id).columns, notes)
        except OSError as error:
            raise LogWriteError.of(file, error) from None
        self._writers[topic] = writer
        self._result.files[topic] = file
        return writer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Complete every file.

        Raises:
            OSError: a file could not be completed.

        """
        self._pool.shutdown()
        with ExitStack() as writers:  # closes all, even after an error
            for writer in self._writers.values():
                writers.callback(writer.close)


def _form(declared: Declared, channel_id: int) -> Form:
    channel = declared.channels[channel_id]
    schema = declared.schemas.get(channel.schema_id)
    if schema is not None:
        try:
            if channel.message_encoding == "protobuf" and schema.encoding == "protobuf":
                return ProtobufForm(schema.name, schema.data)
            if channel.message_encoding == "cdr" and schema.encoding == "ros2msg":
                return RosForm(schema.name, schema.data.decode("utf-8", "replace"))
        except ValueError:
            return Opaque(channel.message_encoding)
    return Opaque(channel.message_encoding)


def as_json(result: Exported) -> str:
    """Return the result as a JSON object."""
    listed: dict[str, Any] = {
        "messages": result.messages,
        "files": {
            topic: {"file": str(file), "rows": result.rows.get(topic, 0)}
            for topic, file in result.files.items()
        },
        "problems": result.problems,
    }
    return json.dumps(listed)
