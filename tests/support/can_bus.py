"""A CAN bus in virtual time: it sends one frame after the other, the lowest identifier first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.can.frames import RECORD, CanFrame, from_record, nominal_bits
from support.hostile import Piece, Wire

if TYPE_CHECKING:
    from collections.abc import Callable

BITRATE = 500_000
_CRC15 = 0x4599
_STUFF_RUN = 5


class Bus:
    """A bus with arbitration and bit times; every node receives all frames except its own.

    A node sends its frames in the order of the requests. A bxCAN controller does this if its TXFP
    bit is set.
    """

    def __init__(self, bitrate: int = BITRATE) -> None:
        self._bitrate = bitrate
        self._waiting: dict[str, list[CanFrame]] = {}
        self._heard: dict[str, list[Piece]] = {}
        self._free_us = 0.0
        self.bits = 0
        self.log: list[tuple[int, str, CanFrame]] = []
        """Completion time, sender and content of each frame."""
        self.spoil: Callable[[CanFrame], int] = lambda _frame: 1
        """Number of copies of a frame that arrive: 0 loses the frame, 2 duplicates it."""

    def join(self, node: str) -> None:
        self._waiting.setdefault(node, [])
        self._heard.setdefault(node, [])

    def request(self, node: str, data: bytes, now_us: int) -> None:
        """Queue frames for sending."""
        self.run(now_us)
        self._free_us = max(self._free_us, now_us)
        for i in range(0, len(data), RECORD.size):
            frame = from_record(data[i : i + RECORD.size])
            assert frame is not None
            self._waiting[node].append(frame)

    def run(self, now_us: int) -> None:
        """Send all frames that are complete by ``now_us``."""
        while True:
            heads = [(queue[0].can_id, node) for node, queue in self._waiting.items() if queue]
            if not heads:
                return
            _, sender = min(heads)
            frame = self._waiting[sender][0]
            bits = frame_bits(frame)
            done_us = self._free_us + bits * 1e6 / self._bitrate
            if done_us > now_us:
                return
            self._waiting[sender].pop(0)
            self._free_us = done_us
            self.bits += bits
            self.log.append((int(done_us), sender, frame))
            record = RECORD.pack(frame.can_id, len(frame.data), frame.data)
            for node, received in self._heard.items():
                if node != sender:
                    received.extend([Piece(int(done_us), record)] * self.spoil(frame))

    def arrived(self, node: str, now_us: int) -> list[Piece]:
        """Return the frames that a node has received since the last call."""
        self.run(now_us)
        received, self._heard[node] = self._heard[node], []
        return received


class BusWire(Wire):
    """A wire that sends as one node and receives as another."""

    def __init__(self, bus: Bus, sender: str, hearer: str) -> None:
        super().__init__()
        self._bus, self._sender, self._hearer = bus, sender, hearer
        bus.join(sender)
        bus.join(hearer)

    def push(self, data: bytes, now_us: int) -> None:
        self._bus.request(self._sender, data, now_us)

    def arrived(self, now_us: int) -> list[Piece]:
        return self._bus.arrived(self._hearer, now_us)

    def next_us(self) -> int | None:
        return None


def frame_bits(frame: CanFrame) -> int:
    """Return the number of bits of this frame, including its stuff bits."""
    length = len(frame.data)
    head = frame.can_id << 7 | length  # start-of-frame bit (0), identifier, RTR, IDE, r0, length
    value = head << 8 * length | int.from_bytes(frame.data, "big")
    count = 19 + 8 * length
    value, count = value << 15 | crc15(value, count), count + 15
    stuffed, run, last = 0, 0, -1
    for position in range(count - 1, -1, -1):
        bit = value >> position & 1
        run = run + 1 if bit == last else 1
        last = bit
        if run == _STUFF_RUN:
            stuffed += 1
            last, run = 1 - bit, 1
    return nominal_bits(length) + stuffed


def crc15(value: int, count: int) -> int:
    """Return the CRC-15/CAN of the last ``count`` bits of a number."""
    crc = 0
    for position in range(count - 1, -1, -1):
        top = (crc >> 14 ^ value >> position) & 1
        crc = (crc << 1 & 0x7FFF) ^ (_CRC15 if top else 0)
    return crc
