"""Bytes of a wire that other programs recorded, read as a log: candump and raw captures.

``candump -l`` names a moment for every frame. A raw capture (what a terminal program saves) has
none: the device's own stamps give the times between its frames, and the file's date the end.
Whatever is decoded goes into an MCAP file as a run's own log has it, so that everything that
reads logs reads captures too.
"""

from __future__ import annotations

import re
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.config import to_toml
from bridge.host_records import HostRecords
from bridge.motion.estimator import PoseEstimator
from bridge.motion.geometry import Pose2
from bridge.motion.robot_model import RobotModel
from bridge.record.chunked import MAGIC
from bridge.record.errors import LogReadError
from bridge.record.writer import RunWriter
from bridge.telemetry import EventRecord, RunInfo, Severity
from bridge.timesync import TimeSync
from protocol.can_frames import RECORD
from protocol.can_link import CanLink
from protocol.clock import DeviceUs, HostNs, extend_us
from protocol.link import Link, Received, Rejected
from protocol.message import Direction
from protocol.messages import Encoders, Hello, Imu, LogText
from protocol.uart import DamagedFrame

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocol.link import LinkBase

CANDUMP, RAW, MCAP = "candump", "raw", "mcap"
_SECOND_NS = 1_000_000_000
_EXTENDED, _REMOTE = 0x8000_0000, 0x4000_0000
_STANDARD_DIGITS = 3
_MAX_CLASSIC = 8
_SNIFFED = 1 << 16
_LOG_LINE = re.compile(
    rb"\((\d+)\.(\d{1,9})\)\s+\S+\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(R?)((?:[0-9A-Fa-f]{2})*)"
)
"""As ``candump -l`` and ``-L`` write it."""
_SHOWN_LINE = re.compile(
    rb"\((\d+)\.(\d{1,9})\)\s+\S+\s+([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})\s+(?:[RT]X\s+\S*\s+)?"
    rb"\[\d+\]\s*(remote)?\s*((?:[0-9A-Fa-f]{2} ?)*)"
)
"""As ``candump -ta`` shows it."""


@dataclass(frozen=True, slots=True)
class _Piece:
    """What arrived in one moment; of a bus one frame."""

    host_ns: int
    data: bytes


def kind_of(path: Path) -> str:
    """What a file is by its first bytes: ``mcap``, ``candump`` or ``raw``.

    Raises:
        LogReadError: it cannot be read.

    """
    try:
        with path.open("rb") as file:
            begin = file.read(_SNIFFED)
    except OSError as error:
        raise LogReadError(path, error.strerror or str(error)) from None
    if begin.startswith(MAGIC[:5]):
        return MCAP
    first = begin.lstrip().split(b"\n", 1)[0]
    return CANDUMP if _LOG_LINE.match(first) or _SHOWN_LINE.match(first) else RAW


@contextmanager
def readable(path: Path) -> Iterator[Path]:
    """An MCAP file of what a file holds: itself, or one made from a capture while needed.

    Raises:
        LogReadError: it cannot be read, or holds nothing of a sweeper.

    """
    if kind_of(path) == MCAP:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="sweepctl-capture-") as folder:
        made = Path(folder) / f"{path.stem}.mcap"
        convert(path, made)
        yield made


def convert(source: Path, target: Path) -> None:
    """Write a capture as a log: raw bytes, device messages, clock and estimate.

    Raises:
        LogReadError: it cannot be read, or holds nothing of a sweeper.
        LogWriteError: the log cannot be written.

    """
    kind = kind_of(source)
    try:
        if kind == CANDUMP:
            pieces = list(_candump(source))
            link: LinkBase = CanLink(Direction.HOST)
        else:
            pieces = list(_raw(source))
            link = Link(Direction.HOST)
    except OSError as error:
        raise LogReadError(source, error.strerror or str(error)) from None
    if not pieces:
        raise LogReadError(
            source, "it is no MCAP file, no candump log, and holds no frame of a sweeper"
        )
    start_ns = pieces[0].host_ns
    model = RobotModel()
    info = RunInfo(
        *(source.name, "", None, "", start_ns, 0, to_toml(model), None),
        {"captured_by": "candump" if kind == CANDUMP else "raw capture"},
    )
    writer = RunWriter(target, info)
    try:
        listener = _Listener(writer, model, link)
        for piece in pieces:
            listener.take(piece)
        if not listener.messages:
            raise LogReadError(source, "none of its frames is a sweeper's")
    finally:
        writer.close()


class _Listener:
    """Puts on record what the live bridge would have, without a word to anybody."""

    def __init__(self, writer: RunWriter, model: RobotModel, link: LinkBase) -> None:
        self.messages = 0
        self._writer, self._link = writer, link
        self._records = HostRecords(writer, 0, "")
        self._sync = TimeSync()
        self._estimator = PoseEstimator(model, Pose2(0.0, 0.0, 0.0))
        self._sends = {s.type_id for s in link.codec.catalogue if s.direction is Direction.HOST}

    def take(self, piece: _Piece) -> None:
        """Record bytes and what they mean."""
        now_ns, data = HostNs(piece.host_ns), piece.data
        if isinstance(self._link, CanLink):
            can_id, _, _ = RECORD.unpack(data)
            self._records.can(data, now_ns, outgoing=can_id >> 4 in self._sends)
        else:
            self._records.uart(data, now_ns, outgoing=False)
        for event in self._link.receive(data, now_ns // 1000):
            match event:
                case Received():
                    self._message(event, now_ns)
                case DamagedFrame():
                    self._records.damaged(event, now_ns)
                case Rejected() if event.reason != "direction":
                    self._records.rejected(event, now_ns)

    def _message(self, received: Received, now_ns: HostNs) -> None:
        message, frame, _ = received
        self.messages += 1
        device_us, mapped = self._sync.observe(frame.t_us, now_ns)
        self._records.message(received, mapped, now_ns)
        match message:
            case Imu():
                self._estimator.on_imu(
                    device_us * 1e-6,
                    *(message.gyro_z_rad_s, message.accel_x_m_s2, message.accel_y_m_s2),
                )
            case Encoders():
                self._estimator.on_encoders(device_us * 1e-6, message.left, message.right)
                if self._estimator.known:
                    self._records.pose(self._estimator.pose, self._estimator, now_ns)
            case LogText():
                self._records.log_text(message, now_ns)
            case Hello() if message.catalogue_hash != self._link.codec.catalogue.hash:
                text = "the device has another catalogue; fields may be missing or misread"
                self._writer.write(
                    EventRecord(now_ns, Severity.WARNING, "session", "schema", text, {})
                )


def _candump(path: Path) -> Iterator[_Piece]:
    """Every classic frame, in the file's order; other lines are passed over."""
    with path.open("rb") as file:
        for line in file:
            match = _LOG_LINE.match(line) or _SHOWN_LINE.match(line)
            if match is None:
                continue
            seconds, fraction, name, remote, hexed = match.groups()
            data = bytes.fromhex(hexed.decode())
            if len(data) > _MAX_CLASSIC:
                continue
            can_id = int(name, 16)
            if len(name) > _STANDARD_DIGITS:
                can_id |= _EXTENDED
            if remote:
                can_id |= _REMOTE
            host_ns = int(seconds) * _SECOND_NS + int(fraction.ljust(9, b"0"))
            yield _Piece(host_ns, RECORD.pack(can_id, len(data), data))


def _raw(path: Path) -> Iterator[_Piece]:
    """A piece for every frame of the device, at the moment that its stamp says."""
    data = path.read_bytes()
    begun, pieces = 0, list[tuple[int, bytes]]()
    known: DeviceUs | None = None
    link = Link(Direction.HOST)
    while begun < len(data):
        end = data.find(b"\0", begun) + 1 or len(data)
        stretch = data[begun:end]
        begun = end
        for event in link.receive(stretch):
            if isinstance(event, Received):
                stamp = event.frame.t_us
                known = DeviceUs(stamp) if known is None else extend_us(known, stamp)
        pieces.append((known or 0, stretch))
    if known is None:
        return
    first_us = next(us for us, _ in pieces if us)
    # The last frame came when the file was last written to, or not long before.
    offset_ns = path.stat().st_mtime_ns - known * 1000
    latest_ns = 0
    for us, stretch in pieces:
        latest_ns = max(latest_ns, max(us, first_us) * 1000 + offset_ns)
        yield _Piece(latest_ns, stretch)
