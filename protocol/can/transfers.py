"""Transfers: contents longer than one CAN frame, split and reassembled.

Each frame ends with a tail byte as in UAVCAN and Cyphal. It contains a start bit, an end bit, a
toggle bit, and a 5-bit transfer counter. The toggle bit does not detect an even number of lost
frames. So a transfer of several frames ends with the CRC-32 that is also used on UART.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple
from zlib import crc32

from protocol.can.frames import T16, T32
from protocol.uart.framing import CRC, MAX_PAYLOAD

START, END, TOGGLE, TRANSFER = 0x80, 0x40, 0x20, 0x1F
_SINGLE = START | END | TOGGLE
SEGMENT = 7
"""Number of content bytes in one frame, without its tail byte."""
FLAG_WHOLE_STAMP = 8
"""Flag in a transfer's first byte: ``t_us`` has 32 bits instead of 16."""
MAX_CONTENT = 1 + T32.size + MAX_PAYLOAD
MAX_OPEN = 16
"""Maximum number of transfers reassembled at the same time: one per node."""
OPEN_US = 1_000_000
"""Maximum duration of a transfer, µs; a longer one is dropped."""


def content(version_flags: int, t_us: int, payload: bytes) -> bytes:
    """Return the content of a transfer: version and flags, stamp, payload.

    The stamp is short only if the content then fits one frame, and would not with a full stamp.
    """
    short = 1 + T16.size + len(payload)
    if short <= SEGMENT < 1 + T32.size + len(payload):
        return bytes((version_flags,)) + T16.pack(t_us >> 4 & 0xFFFF) + payload
    return bytes((version_flags | FLAG_WHOLE_STAMP,)) + T32.pack(t_us & 0xFFFF_FFFF) + payload


class Content(NamedTuple):
    """A transfer's content, parsed."""

    version_flags: int
    whole: bool
    """True if the stamp has 32 bits."""
    stamp: int
    payload: bytes


def parse_content(data: bytes) -> Content | None:
    """Parse a content; return None if it is too short."""
    whole = bool(data) and bool(data[0] & FLAG_WHOLE_STAMP)
    stamp = T32 if whole else T16
    if len(data) < 1 + stamp.size:
        return None
    (value,) = stamp.unpack_from(data, 1)
    return Content(data[0] & ~FLAG_WHOLE_STAMP, whole, value, data[1 + stamp.size :])


def segments(data: bytes, transfer_id: int) -> list[bytes]:
    """Split a content into the data of frames."""
    transfer = transfer_id & TRANSFER
    if len(data) <= SEGMENT:
        return [data + bytes((_SINGLE | transfer,))]
    data += CRC.pack(crc32(data))
    cut = [data[i : i + SEGMENT] for i in range(0, len(data), SEGMENT)]
    last = len(cut) - 1
    return [
        piece
        + bytes(
            (
                transfer
                | (START if i == 0 else 0)
                | (END if i == last else 0)
                | (0 if i % 2 else TOGGLE),
            )
        )
        for i, piece in enumerate(cut)
    ]


class TransferResult(Enum):
    """Result of processing one segment."""

    PART = "part"
    """Accepted; more segments follow."""
    STRAY = "stray"
    """The segment belongs to no open transfer, because an earlier segment was lost."""
    DAMAGED = "damaged"
    """The transfer is complete, but its CRC is wrong."""


class _Open:
    __slots__ = ("began_us", "data", "next_toggle", "transfer")

    def __init__(self, piece: bytes, transfer: int, now_us: int) -> None:
        self.data = bytearray(piece)
        self.transfer = transfer
        self.next_toggle = 0
        self.began_us = now_us


class Reassembler:
    """Reassembles transfers, with bounded memory for any input.

    The caller must remove duplicate frames. A duplicate directly follows its original.
    """

    def __init__(self) -> None:
        self.given_up = 0
        """Number of transfers that began but were dropped before completion."""
        self._open: dict[int, _Open] = {}

    @property
    def held_bytes(self) -> int:
        """Size of the content of open transfers, bytes."""
        return sum(len(o.data) for o in self._open.values())

    def feed(self, can_id: int, data: bytes, now_us: int) -> bytes | TransferResult:
        """Process a frame; return the content that it completes, or the result of the segment."""
        if not data:
            return TransferResult.STRAY
        piece, tail = data[:-1], data[-1]
        if tail & START:
            return self._begin(can_id, piece, tail, now_us)
        opened = self._open.get(can_id)
        if opened is None:
            return TransferResult.STRAY
        if (
            tail & TOGGLE != opened.next_toggle
            or tail & TRANSFER != opened.transfer
            or not piece
            or now_us - opened.began_us > OPEN_US
            or len(opened.data) + len(piece) > MAX_CONTENT + CRC.size
        ):
            self._give_up(can_id)
            return TransferResult.STRAY
        opened.data += piece
        opened.next_toggle ^= TOGGLE
        if not tail & END:
            return TransferResult.PART
        del self._open[can_id]
        return self._check(bytes(opened.data))

    def _begin(self, can_id: int, piece: bytes, tail: int, now_us: int) -> bytes | TransferResult:
        if can_id in self._open:
            self._give_up(can_id)
        if not tail & TOGGLE or not piece:
            return TransferResult.STRAY
        if tail & END:
            return piece
        if len(self._open) >= MAX_OPEN:
            self._give_up(next(iter(self._open)))
        self._open[can_id] = _Open(piece, tail & TRANSFER, now_us)
        return TransferResult.PART

    def _give_up(self, can_id: int) -> None:
        del self._open[can_id]
        self.given_up += 1

    @staticmethod
    def _check(data: bytes) -> bytes | TransferResult:
        whole, given = data[: -CRC.size], data[-CRC.size :]
        if len(whole) <= SEGMENT or CRC.pack(crc32(whole)) != given:
            return TransferResult.DAMAGED
        return whole
