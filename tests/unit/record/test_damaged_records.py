"""Damaged and rejected frames in the log: grouped events, complete counts and exact bytes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.convert.listening import Listener
from bridge.motion.robot_model import RobotModel
from bridge.record.log_writer import RunWriter
from bridge.run.ending import Ending
from bridge.run.recording import GATHER_NS, SHOWN_BYTES, HostRecords
from bridge.session.records import EventRecord, RawBytes, RunInfo
from bridge.session.states import State
from bridge.view.report.run_data import frames_of, load_run
from protocol.clock import HostNs
from protocol.schema.message import Direction
from protocol.uart.framing import Damage, DamagedFrame, encode_frame
from protocol.uart.link import Link
from support.ends import Collector, Ends, HostEnd, spinning_host, sweeper
from support.hostile import Pipe

if TYPE_CHECKING:
    from pathlib import Path

    from bridge.run.host import Host

LINE_BYTES_S = 300_000
"""Bytes per second of a 3 Mbaud line."""
READ_NS = 10_000_000
NOISE = b"\2\1\7\0"
"""A damaged frame of three bytes."""
MS = 1_000_000


def events(sink: Collector, kind: str) -> list[EventRecord]:
    return [e for e in sink.of(EventRecord) if (e.source, e.kind) == ("link", kind)]


def ready() -> tuple[Host, Collector, int]:
    sink = Collector()
    host = spinning_host(sink)
    host.mission.runner = None
    ends = Ends(HostEnd(host), sweeper(), to_host=Pipe(1_000))
    ends.run(2.0)
    assert host.session.state is State.READY
    sink.records.clear()
    return host, sink, ends.host_ns


def flood(host: Host, piece: bytes, begin_ns: int, seconds: float) -> tuple[int, bytes]:
    """Send repetitions of a piece at the full rate of the link; return end time and sent bytes."""
    count = LINE_BYTES_S * READ_NS // 1_000_000_000 // len(piece)
    sent, now_ns = b"", begin_ns
    while now_ns < begin_ns + seconds * 1e9:
        now_ns += READ_NS
        host.receive(piece * count, HostNs(now_ns))
        host.poll(HostNs(now_ns))
        host.data_to_send(HostNs(now_ns))
        sent += piece * count
    return now_ns, sent


@pytest.mark.parametrize("kind", ["damaged", "rejected"])
def test_a_full_line_of_them_makes_five_records_in_a_second_and_loses_none(kind: str) -> None:
    host, sink, now_ns = ready()
    # A frame from the device's node whose type is in no catalogue.
    strange = b"\0" + encode_frame(1, 0x7D, 0, 0, b"abc")
    now_ns, sent = flood(host, NOISE if kind == "damaged" else strange, now_ns, 1.0)
    host.end(Ending("stopped", "the test is over", 0), HostNs(now_ns))
    for _ in range(80):  # the stop gets no answer
        now_ns += READ_NS * 2
        host.poll(HostNs(now_ns))
    assert host.mission.done
    reported = events(sink, kind)
    statistics = host.session.link.statistics
    assert len(reported) <= 1 + 1.0 / (GATHER_NS / 1e9) + 1
    count = statistics.damaged if kind == "damaged" else statistics.rejected
    assert sum(e.data["frames"] for e in reported) == count > 5_000
    assert b"".join(r.data for r in sink.of(RawBytes) if not r.outgoing) == sent


def test_the_record_names_the_errors_and_shows_the_first_bytes() -> None:
    sink = Collector()
    records = HostRecords(sink, 0, "")
    first = DamagedFrame(Damage.CRC, 100, 40, bytes(range(1, 41)))
    records.damaged([first], 5 * MS)
    more = [DamagedFrame(Damage.COBS, 141 + 4 * i, 3, b"\2\1\7") for i in range(6)]
    records.damaged([*more, first], 10 * MS)
    assert len(sink.records) == 1
    records.flush(5 * MS + GATHER_NS - 1)
    assert len(sink.records) == 1
    records.flush(5 * MS + GATHER_NS)
    one, many = events(sink, "damaged")
    assert one.text == "received 40 bytes that are not a frame (crc)"
    assert one.data == {
        "offset": 100,
        "first": bytes(range(1, SHOWN_BYTES + 1)).hex(),
        "frames": 1,
        "bytes": 40,
        "crc": 1,
    }
    assert many.text == "received 58 bytes in 7 parts that are not a frame (cobs 6, crc 1)"
    assert many.data == {
        "offset": 141,
        "first": "020107",
        "frames": 7,
        "bytes": 58,
        "cobs": 6,
        "crc": 1,
    }
    records.flush(10**12, at_once=True)
    assert len(sink.records) == 2, "all damage has been reported"


def test_rare_ones_are_recorded_at_once() -> None:
    sink = Collector()
    records = HostRecords(sink, 0, "")
    for at_ns in range(0, 10 * GATHER_NS, GATHER_NS):
        records.damaged([DamagedFrame(Damage.CRC, 0, 9, b"x" * 9)], at_ns)
    assert [e.log_ns for e in sink.of(EventRecord)] == list(range(0, 10 * GATHER_NS, GATHER_NS))


def test_a_listener_of_a_capture_has_them_all() -> None:
    sink = Collector()
    listener = Listener(sink, RobotModel(), Link(Direction.HOST))
    for read in range(100):
        listener.received(NOISE * 50, HostNs(1 + read * MS))
    listener.close()
    reported = events(sink, "damaged")
    assert sum(e.data["frames"] for e in reported) == 5_000
    assert len(reported) == 2


def test_a_report_counts_frames_and_not_records(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    writer = RunWriter(log, RunInfo("port", "", None, "test", 1, 0, RobotModel(), ""))
    records = HostRecords(writer, 0, "")
    records.damaged([DamagedFrame(Damage.CRC, 0, 9, b"x" * 9)] * 12, 5)
    records.flush(10, at_once=True)
    writer.close()
    assert load_run(log).damaged == 12


@pytest.mark.parametrize(
    ("text", "frames"),
    [("", 1), ("{}", 1), ("[]", 1), ('{"frames": "x"}', 1), ('{"frames": 30}', 30)],
)
def test_an_event_without_a_number_is_of_one_frame(text: str, frames: int) -> None:
    assert frames_of(text) == frames
