"""Import of captures of other programs: candump logs and raw serial bytes.

``candump -l`` stores a time for every frame. A raw capture of a terminal program has no times. Its
intervals are computed from the device's stamps, and its end is the file's date. The result is an
MCAP file like the log of a run, so every command for logs also supports captures.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from itertools import chain, islice
from typing import TYPE_CHECKING

from bridge.config import to_toml
from bridge.convert.file_kinds import CANDUMP, LOG_LINE, SHOWN_LINE, kind_of
from bridge.convert.listening import Listener
from bridge.files import open_to_read
from bridge.motion.robot_model import RobotModel
from bridge.record.errors import LogReadError
from bridge.record.log_writer import RunWriter
from bridge.record.names import readable_name
from bridge.record.reader import LATEST_NS
from bridge.session.records import RunInfo
from protocol.can.frames import RECORD
from protocol.can.link import CanLink
from protocol.clock import DeviceUs, HostNs, extend_us
from protocol.link import Received
from protocol.schema.message import Direction
from protocol.uart.framing import CRC, HEADER
from protocol.uart.link import Link

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from protocol.link import LinkBase

MAX_RAW_BYTES = 256 << 20
"""Maximum size of a raw capture, bytes. It is fifteen hours at the default rates. A raw capture is
read into memory."""
_READ = 1 << 20
_SECOND_NS = 1_000_000_000
_EXTENDED, _REMOTE = 0x8000_0000, 0x4000_0000
_STANDARD_DIGITS = 3
_MAX_CLASSIC = 8
_SHORTEST = 1 + HEADER.size + CRC.size + 1
"""Minimum size of a frame, bytes. It is the sum of COBS byte, header, CRC and zero."""
MAX_LINE = 512
"""Maximum length of a candump line, bytes. A classic frame needs about 100 bytes."""


@dataclass(frozen=True, slots=True)
class _Piece:
    """Bytes with one arrival time; on a bus, one frame."""

    host_ns: int
    data: bytes


def convert(source: Path, target: Path) -> None:
    """Convert a capture to a log: raw bytes, device messages, clock and estimate.

    Raises:
        LogReadError: the file cannot be read, or has no frame of a device.
        LogWriteError: the log cannot be written.

    """
    kind = kind_of(source)
    link: LinkBase = (CanLink if kind == CANDUMP else Link)(Direction.HOST)
    try:
        _write(source, target, kind, link)
    except OSError as error:
        raise LogReadError(source, error.strerror or str(error)) from None


def _write(source: Path, target: Path, kind: str, link: LinkBase) -> None:
    """Convert in pieces, because a capture may be larger than the memory."""
    pieces = _candump(source) if kind == CANDUMP else _raw(source)
    first = next(pieces, None)
    if first is None:
        raise LogReadError(
            source, "it is not an MCAP file or a candump log, and has no frame of a device"
        )
    model = RobotModel()
    info = RunInfo(
        *(readable_name(source.name), "", None, "", first.host_ns, 0, model, to_toml(model), None),
        {"captured_by": "candump" if kind == CANDUMP else "raw capture"},
    )
    writer = RunWriter(target, info)
    try:
        listener = Listener(writer, model, link)
        for piece in chain((first,), pieces):
            listener.received(piece.data, HostNs(piece.host_ns))
        listener.close()
        if not listener.messages:
            raise LogReadError(source, "none of its frames is from a device")
    finally:
        writer.close()


def _candump(path: Path) -> Iterator[_Piece]:
    """Yield every classic frame in the file's order; other lines are skipped."""
    with open_to_read(path) as file:
        # Only the first part of a longer line is read. A longer line is not a frame.
        for line in iter(lambda: file.readline(MAX_LINE), b""):
            match = LOG_LINE.match(line) or SHOWN_LINE.match(line)
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
            if host_ns <= LATEST_NS:
                yield _Piece(host_ns, RECORD.pack(can_id, len(data), data))


def _raw(path: Path) -> Iterator[_Piece]:
    """Yield a piece for each device frame, at the time of its stamp."""
    with open_to_read(path) as file:
        reads = iter(lambda: file.read(_READ), b"")
        data = b"".join(islice(reads, MAX_RAW_BYTES // _READ + 1))
    if len(data) > MAX_RAW_BYTES:
        raise LogReadError(path, f"the capture exceeds {MAX_RAW_BYTES >> 20} MiB; split it")
    stamps, ends = array("Q"), array("Q")
    known: DeviceUs | None = None
    link = Link(Direction.HOST)
    begun = 0
    while begun < len(data):
        # Zeros and noise are grouped up to the minimum frame size, so they take no more time than
        # frames.
        end = data.find(b"\0", begun + _SHORTEST - 1) + 1 or len(data)
        stretch = data[begun:end]
        for event in link.receive(stretch) if stretch.strip(b"\0") else ():
            if isinstance(event, Received):
                stamp = event.frame.t_us
                known = DeviceUs(stamp) if known is None else extend_us(known, stamp)
        stamps.append(known or 0)
        ends.append(end)
        begun = end
    if known is None:
        return
    first_us = next(us for us in stamps if us)
    # The last frame arrived shortly before the file's last write.
    offset_ns = path.stat().st_mtime_ns - known * 1000
    latest_ns = begun = 0
    for us, end in zip(stamps, ends, strict=True):
        latest_ns = max(latest_ns, max(us, first_us) * 1000 + offset_ns)
        yield _Piece(latest_ns, data[begun:end])
        begun = end
