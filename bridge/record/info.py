"""Statistics of a log."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bridge.record.names import DEVICE_METADATA
from bridge.record.reader import LogMessage, LogReader
from bridge.record.wire_records import RAW_CAN

if TYPE_CHECKING:
    from pathlib import Path

_NANOSECONDS = 1e9
_MIN_COUNT, _MIN_SPAN_NS = 3, 1_000_000_000
"""Minimum number of messages and minimum time span for a rate. In a short log, half of the log's
duration is enough."""
_RAW = {"/raw/uart/rx": "received_bytes", "/raw/uart/tx": "sent_bytes"}


@dataclass(slots=True)
class TopicDescription:
    """Statistics of one topic."""

    topic: str
    schema: str
    encoding: str
    count: int = 0
    bytes: int = 0
    """Size of the messages before compression, bytes."""
    first_ns: int = 0
    last_ns: int = 0
    rate_hz: float | None = None
    """Mean rate between the first and the last message, Hz; None: too few messages."""

    def update_rate(self, duration_ns: int) -> None:
        """Compute the rate for a log of this duration, ns."""
        span_ns = self.last_ns - self.first_ns
        if self.count >= _MIN_COUNT and span_ns >= min(_MIN_SPAN_NS, duration_ns / 2) > 0:
            self.rate_hz = (self.count - 1) / (span_ns / _NANOSECONDS)


@dataclass(slots=True)
class RunDescription:
    """Statistics of one log."""

    path: Path
    file_bytes: int
    whole: bool
    """False: the end of the log is missing, and the statistics are of the part that exists."""
    problems: list[str]
    """Damage that was skipped, one line each."""
    metadata: dict[str, str]
    """Metadata of the run: version, port, planner, seed and others."""
    attachments: dict[str, int]
    """Size of each attachment, bytes."""
    summary: dict[str, Any] | None
    """Summary of the run; None: the log ends before the summary."""
    start_ns: int = 0
    """Unix time of the first message, ns; 0: no message."""
    end_ns: int = 0
    topics: list[TopicDescription] = field(default_factory=list)
    wire: dict[str, Any] = field(default_factory=dict)
    """Link statistics from the summary; without a summary, counted from the messages."""
    parts: list[Path] = field(default_factory=list)
    """Files of the run, if it has several."""
    format: str = "mcap"
    """``mcap``, or ``candump`` or ``raw`` for a capture, whose topics are the decoded messages."""

    @property
    def duration_s(self) -> float:
        """Time from the first to the last message, s."""
        return (self.end_ns - self.start_ns) / _NANOSECONDS

    @property
    def message_count(self) -> int:
        """Number of messages of all topics."""
        return sum(topic.count for topic in self.topics)

    @property
    def outcome(self) -> str | None:
        """Outcome of the run; None: unknown."""
        outcome = (self.summary or {}).get("outcome")
        return outcome if isinstance(outcome, str) else None

    def as_json(self) -> dict[str, Any]:
        """Return all fields as values for JSON."""
        return {
            "path": str(self.path),
            "format": self.format,
            "parts": [str(part) for part in self.parts],
            "file_bytes": self.file_bytes,
            "whole": self.whole,
            "problems": self.problems,
            "duration_s": round(self.duration_s, 6),
            "start_ns": self.start_ns,
            "end_ns": self.end_ns,
            "messages": self.message_count,
            "outcome": self.outcome,
            "metadata": self.metadata,
            "attachments": self.attachments,
            "topics": [
                {
                    "topic": t.topic,
                    "schema": t.schema,
                    "encoding": t.encoding,
                    "count": t.count,
                    "rate_hz": None if t.rate_hz is None else round(t.rate_hz, 3),
                    "bytes": t.bytes,
                }
                for t in self.topics
            ],
            "wire": self.wire,
            "summary": self.summary,
        }


def describe(path: Path) -> RunDescription:
    """Read a log and return its statistics.

    Raises:
        LogReadError: the file is missing, cannot be read, or is not an MCAP file.

    """
    reader = LogReader(path)
    topics: dict[str, TopicDescription] = {}
    wire_bytes: dict[str, int] = {}
    for message in reader.messages():
        topic = topics.get(message.channel.topic)
        if topic is None:
            channel = message.channel
            topic = topics[channel.topic] = TopicDescription(
                channel.topic, channel.schema_name, channel.message_encoding
            )
            topic.first_ns = topic.last_ns = message.log_ns
        topic.count += 1
        topic.bytes += len(message.data)
        raw = _raw_name(message)
        if raw is not None:
            wire_bytes[raw] = wire_bytes.get(raw, 0) + _payload(message)
        topic.first_ns = min(topic.first_ns, message.log_ns)
        topic.last_ns = max(topic.last_ns, message.log_ns)
    summary = reader.summary
    description = RunDescription(
        path,
        reader.bytes,
        not reader.truncated,
        reader.problems,
        {**reader.metadata.get(DEVICE_METADATA, {}), **reader.run},
        reader.attachment_bytes,
        summary,
        topics=sorted(topics.values(), key=lambda t: t.topic),
        parts=reader.parts if len(reader.parts) > 1 else [],
    )
    if topics:
        description.start_ns = min(t.first_ns for t in topics.values())
        description.end_ns = max(t.last_ns for t in topics.values())
        for topic in topics.values():
            topic.update_rate(description.end_ns - description.start_ns)
    wire = (summary or {}).get("wire")
    description.wire = wire if isinstance(wire, dict) else _counted_wire(topics, wire_bytes)
    return description


def _raw_name(message: LogMessage) -> str | None:
    """Return the name of the statistic that a raw message counts for; None for other topics."""
    topic = message.channel.topic
    if topic != RAW_CAN:
        return _RAW.get(topic)
    try:
        return "sent_bytes" if message.decoded.outgoing else "received_bytes"
    except (ValueError, AttributeError, TypeError):  # another program's topic with this name
        return None


def _payload(message: LogMessage) -> int:
    try:
        return len(message.decoded.data)
    except (ValueError, AttributeError, TypeError):  # another program's topic with this name
        return len(message.data)


def _counted_wire(
    topics: dict[str, TopicDescription], wire_bytes: dict[str, int]
) -> dict[str, Any]:
    """Count link statistics from the messages. Losses and errors are unknown (None)."""
    device = [t.count for name, t in topics.items() if name.startswith("/device/")]
    return {
        "frames": sum(device) if device else None,
        "lost": None,
        "crc_errors": None,
        **{key: wire_bytes.get(key) for key in _RAW.values()},
    }
