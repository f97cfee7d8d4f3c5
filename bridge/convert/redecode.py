"""Second decoding of a log's raw bytes, to prove that no message was lost.

A new session and time synchronisation receive the recorded bytes at their recorded times. The
host's recorded bytes show when the session was polled and which session ids it used.
"""

from __future__ import annotations

import json
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from bridge.record.encode.schemas import DeviceEncoder, device_encoders
from bridge.record.errors import LogReadError
from bridge.record.reader import MISREAD, LogReader
from bridge.record.version_1 import is_version_1
from bridge.record.wire_records import RAW_TOPICS, in_order, wire_records
from bridge.session.discovery import LISTEN_NS
from bridge.session.event_kinds import EventKind
from bridge.session.ingest import Ingest
from bridge.session.session import Session
from bridge.session.states import Data, Ping, SessionReady
from bridge.session.timesync import TimeSync
from protocol.can.link import CanLink
from protocol.clock import HostNs
from protocol.imu import ImuScale
from protocol.link import Received
from protocol.messages.device import Imu, ImuInfo
from protocol.messages.host import HostHello
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bridge.record.wire_records import WireRecord
    from protocol.link import LinkBase


class Decoded(NamedTuple):
    """A device message in a log."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


@dataclass(slots=True)
class Redecoded:
    """Result of the comparison of recorded and decoded messages."""

    recorded: int = 0
    equal: int = 0
    differing: dict[str, int] = field(default_factory=dict)
    """Number of different, missing or extra messages, by topic."""
    first: str = ""
    """Description of the first difference."""

    @property
    def same(self) -> bool:
        """True if all messages are identical, bit for bit."""
        return not self.differing


def compare(path: Path) -> Redecoded:
    """Decode a log's raw bytes again and compare them with its ``/device/*`` messages.

    Raises:
        LogReadError: the file is missing, cannot be read, or is not an MCAP file.

    """
    reader = LogReader(path)
    if is_version_1(reader):
        why = "its bytes are of version 0.1; sweepctl reads them, but cannot compare them"
        raise LogReadError(path, why)
    recorded: dict[str, list[Decoded]] = defaultdict(list)
    for message in reader.messages(_DeviceTopics()):
        topic = message.channel.topic
        recorded[topic].append(Decoded(topic, *message[1:]))
    again: dict[str, list[Decoded]] = defaultdict(list)
    for decoded in redecode(reader):
        again[decoded.topic].append(decoded)
    result = Redecoded(sum(map(len, recorded.values())))
    for topic in sorted({*recorded, *again}):
        then, now = recorded[topic], again[topic]
        equal = sum(a == b for a, b in zip(then, now, strict=False))
        result.equal += equal
        wrong = max(len(then), len(now)) - equal
        if wrong:
            result.differing[topic] = wrong
            result.first = result.first or _difference(topic, then, now)
    return result


def redecode(reader: LogReader) -> Iterator[Decoded]:
    """Yield every ``/device/*`` message from a log's raw bytes, with the decoder of a live run."""
    offset_ns = _number(reader.run.get("clock_offset_ns")) or 0
    records = sorted(wire_records(reader.messages(RAW_TOPICS)), key=in_order)
    if not records:
        return
    link = CanLink if records[0].is_can else Link
    ids = _session_ids(records, link)
    session = Session(lambda: next(ids, 1), node=_node(reader), link=link)
    ingest, encoders = Ingest(TimeSync(), offset_ns), device_encoders()
    imu = CATALOGUE.spec(Imu)
    encoders[imu.name] = DeviceEncoder(imu, has_si=False)  # as in a log before the scale is known
    session.open(HostNs(_opened_ns(reader, records) - offset_ns))
    for record in records:
        now_ns = HostNs(record.log_ns - offset_ns)
        if record.outgoing:
            events = session.poll(now_ns)
            session.data_to_send()
        else:
            events = session.receive(record.data, now_ns)
        for event in events:
            match event:
                case Data():
                    made = ingest.take(event.received, now_ns)
                    scale = ImuScale.of(made.message) if isinstance(made.message, ImuInfo) else None
                    if scale is not None:
                        encoders[imu.name] = DeviceEncoder(scale.declared(imu))
                    data = encoders[made.name].encode(made)
                    time_ns = made.log_ns if made.publish_ns is None else made.publish_ns
                    yield Decoded(f"/device/{made.name}", made.log_ns, time_ns, made.seq, data)
                case Ping():
                    ingest.exchange(event)
                case SessionReady() if event.rebooted:
                    ingest.reset()


class _DeviceTopics:
    def __contains__(self, topic: object) -> bool:
        return str(topic).startswith("/device/")


def _session_ids(records: list[WireRecord], link: type[LinkBase]) -> Iterator[int]:
    """Return the session ids of the host's hellos, each once, in order."""
    peer = link(Direction.DEVICE)
    last = 0
    found = []
    for record in records:
        if not record.outgoing:
            continue
        for event in peer.receive(record.data, record.log_ns // 1000):
            if isinstance(event, Received) and isinstance(event.message, HostHello):
                if event.message.session_id != last:
                    found.append(event.message.session_id)
                last = event.message.session_id
    return iter(found)


def _node(reader: LogReader) -> int | None:
    """Return the node of the run's device; None: unknown."""
    return _number(reader.metadata.get("device", {}).get("node"))


def _number(text: str | None) -> int | None:
    """Parse a number in a log's metadata; None if it is not a number."""
    try:
        return None if text is None else int(text)
    except ValueError:
        return None


def _opened_ns(reader: LogReader, records: list[WireRecord]) -> int:
    """Return the opening time of the session, from its first event if that is early enough."""
    opened_ns = records[0].log_ns
    if records[0].is_can:  # a CAN session listens before its first hello
        sent = (record.log_ns for record in records if record.outgoing)
        opened_ns = min(opened_ns, next(sent, opened_ns + LISTEN_NS) - LISTEN_NS)
    for message in reader.messages({"/events"}):
        with suppress(*MISREAD):
            event = message.decoded
            if event.source == "session" and event.kind == EventKind.OPENING:
                return min(message.log_ns, opened_ns)
    return opened_ns


def _difference(topic: str, then: list[Decoded], now: list[Decoded]) -> str:
    for index, (a, b) in enumerate(zip(then, now, strict=False)):
        if a != b:
            names = ("topic", "log time", "publish time", "sequence", "content")
            what = [name for name, x, y in zip(names, a, b, strict=True) if x != y]
            return f"{topic}: message {index} differs in {', '.join(what)}"
    return f"{topic}: {len(then)} recorded, {len(now)} in the raw bytes"


def as_json(result: Redecoded) -> str:
    """Return the comparison as a JSON object."""
    return json.dumps(
        {
            "recorded": result.recorded,
            "equal": result.equal,
            "same": result.same,
            "differing": result.differing,
            "first_difference": result.first or None,
        }
    )
