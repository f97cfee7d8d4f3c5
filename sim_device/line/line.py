"""The line between device and host in time: UART, USB adapter, CAN bus, and their buffers.

Sans-I/O: bytes and time go in with :meth:`Channel.push`, what has arrived by a moment comes out
of :meth:`Channel.pull`, and :meth:`Channel.next_us` says when that is. One channel is one
direction. Moments are microseconds since the device was switched on and never go back.

What is modelled, device to host: the device's transmit buffer; the UART, 10 bits a byte (8N1);
the adapter, which hands bytes over when 62 are there or when its latency timer fires (FTDI
AN232B-04: the timer runs freely from the last hand-over; 62 is a 64-byte USB packet less two
of status). Host to device: the adapter's buffer and the UART; a host that writes faster is held
back by USB, so nothing is lost there. The adapter's buffer towards a host that does not read
belongs to whoever owns the port (:class:`sim_device.rig.Rig`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.can.frames import RECORD, worst_bits

if TYPE_CHECKING:
    from collections.abc import Callable

DEFAULT_BAUD = 921_600
DEFAULT_LATENCY_US = 1_000
DEFAULT_BITRATE = 500_000
BITS_PER_BYTE = 10
"""8N1: start, eight of data, stop."""
PACKET = 62
FIFO_BYTES = 4096
"""An adapter's buffer per direction (FT232H: 1 KiB, FT2232H: 4 KiB)."""
TRANSMIT_BYTES = 4096
"""The device's buffer for bytes that wait for the UART."""
CAN_QUEUE = 64
"""Frames that wait for the bus, in the controller's mailboxes and the driver's queue."""
_US = 1_000_000
_CHUNK = 64
"""The device looks at its receive buffer at the latest after this many bytes: half a DMA ring."""


@dataclass(frozen=True, slots=True)
class LineSettings:
    """How a device is connected; the defaults are a USB serial adapter in low-latency mode."""

    baud: int = DEFAULT_BAUD
    """Baud rate of the UART; 0: bytes take no time."""
    latency_us: int = DEFAULT_LATENCY_US
    """Latency timer of the adapter, µs; 0: no adapter, bytes are delivered when the link falls
    idle."""
    bitrate: int = 0
    """Bit rate of a CAN bus, instead of ``baud``; 0: no bus."""


STRAIGHT = LineSettings(0, 0)
"""No time, no limit: for tests, and where something else models the line."""


class Channel(ABC):
    """One direction of a line."""

    def __init__(self) -> None:
        self.overrun = 0
        """Bytes lost because a buffer on this side of the line was full."""

    @abstractmethod
    def push(self, data: bytes, now_us: int) -> None:
        """Write bytes at the near end."""

    @abstractmethod
    def pull(self, now_us: int) -> bytes:
        """Fetch what has arrived at the far end."""

    @abstractmethod
    def next_us(self) -> int | None:
        """Time of the next arrival, µs; ``None``: nothing is in flight."""

    @abstractmethod
    def clear(self) -> None:
        """Drop the bytes in flight: the plug was pulled."""

    def room(self) -> int:
        """Bytes that can be pushed now without loss."""
        return FIFO_BYTES


class StraightChannel(Channel):
    """Bytes arrive in the moment in which they are written."""

    def __init__(self, damage: Callable[[bytes], bytes]) -> None:
        super().__init__()
        self._damage = damage
        self._data = b""
        self._at_us = 0

    def push(self, data: bytes, now_us: int) -> None:
        """Write bytes."""
        if data:
            self._data += self._damage(data)
            self._at_us = now_us

    def pull(self, now_us: int) -> bytes:
        """Fetch them."""
        if now_us < self._at_us:
            return b""
        data, self._data = self._data, b""
        return data

    def next_us(self) -> int | None:
        """At once."""
        return self._at_us if self._data else None

    def clear(self) -> None:
        """Lose them."""
        self._data = b""


class Wire:
    """A UART's shift register and what waits for it: exact to the microsecond."""

    def __init__(self, baud: int, capacity: int) -> None:
        self._baud = baud
        self._capacity = capacity
        self._waiting = bytearray()
        self._began_us = 0
        self._sent = 0
        """Bytes sent since the line was last idle, which it was until ``_began_us``."""
        self.overrun = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def room(self) -> int:
        """Bytes that still fit."""
        return self._capacity - len(self._waiting)

    def put(self, data: bytes, now_us: int) -> None:
        """Queue what fits; the rest is lost and counted. The line is up to date with now."""
        if not self._waiting and data and now_us >= self.after_us(0):
            self._began_us, self._sent = now_us, 0
        room = self.room
        if len(data) > room:
            self.overrun += len(data) - room
            data = data[:room]
        self._waiting += data

    def after_us(self, count: int) -> int:
        """When so many more bytes will have left, rounded up."""
        bits = (self._sent + count) * BITS_PER_BYTE * _US
        return self._began_us + -(-bits // self._baud)

    def take(self, now_us: int) -> bytes:
        """The bytes that have left by now."""
        if not self._waiting:
            return b""
        sent = (now_us - self._began_us) * self._baud // (BITS_PER_BYTE * _US)
        count = min(len(self._waiting), max(0, sent - self._sent))
        data = bytes(self._waiting[:count])
        del self._waiting[:count]
        self._sent += count
        return data

    def clear(self) -> None:
        """Forget what waits."""
        self._waiting.clear()


class UartUp(Channel):
    """Device to host: transmit buffer, UART, adapter with its latency timer."""

    def __init__(self, baud: int, latency_us: int, damage: Callable[[bytes], bytes]) -> None:
        super().__init__()
        self._wire = Wire(baud, TRANSMIT_BYTES)
        self._latency_us = latency_us
        self._damage = damage
        self._packet = bytearray()
        self._handed = bytearray()
        self._timer_us = 0
        """A moment at which the timer fired; it has fired each ``latency_us`` since."""

    def push(self, data: bytes, now_us: int) -> None:
        """Put bytes into the device's transmit buffer."""
        self._run(now_us)
        self._wire.put(data, now_us)
        self.overrun = self._wire.overrun

    def pull(self, now_us: int) -> bytes:
        """Fetch what the adapter has handed over."""
        self._run(now_us)
        data = bytes(self._handed)
        self._handed.clear()
        return data

    def next_us(self) -> int | None:
        """When the adapter hands over next."""
        if self._handed:
            return self._timer_us
        return self._next_packet_us()

    def clear(self) -> None:
        """Drop the bytes in flight."""
        self._wire.clear()
        self._packet.clear()
        self._handed.clear()

    def _next_packet_us(self) -> int | None:
        waiting = len(self._wire)
        if not waiting and not self._packet:
            return None
        missing = max(0, PACKET - len(self._packet))
        full_us = self._wire.after_us(missing) if waiting >= missing else None
        if self._latency_us == 0:
            return full_us if full_us is not None else self._wire.after_us(waiting)
        first_us = self._wire.after_us(0 if self._packet else 1)
        timer_us = self._fires_us(max(first_us, self._timer_us + 1))
        return timer_us if full_us is None else min(full_us, timer_us)

    def _fires_us(self, at_least_us: int) -> int:
        """The first moment not before this at which the timer fires."""
        periods = -(-(at_least_us - self._timer_us) // self._latency_us)
        return self._timer_us + periods * self._latency_us

    def _run(self, now_us: int) -> None:
        while (at_us := self._next_packet_us()) is not None and at_us <= now_us:
            self._packet += self._damage(self._wire.take(at_us))
            self._handed += self._packet
            self._packet.clear()
            self._timer_us = at_us
        self._packet += self._damage(self._wire.take(now_us))


class UartDown(Channel):
    """Host to device: the adapter's buffer and the UART.

    The device receives bytes when the link falls idle, and after each 64.
    """

    def __init__(self, baud: int, damage: Callable[[bytes], bytes]) -> None:
        super().__init__()
        self._wire = Wire(baud, FIFO_BYTES)
        self._damage = damage

    def push(self, data: bytes, now_us: int) -> None:
        """Pass bytes to the adapter; :meth:`room` gives the free space."""
        self._wire.put(data, now_us)
        self.overrun = self._wire.overrun

    def pull(self, now_us: int) -> bytes:
        """Fetch what has come out of the UART."""
        data = self._wire.take(now_us)
        return self._damage(data) if data else b""

    def next_us(self) -> int | None:
        """When the device's receive interrupt comes."""
        waiting = len(self._wire)
        return self._wire.after_us(min(waiting, _CHUNK)) if waiting else None

    def room(self) -> int:
        """Bytes that the adapter takes."""
        return self._wire.room

    def clear(self) -> None:
        """Drop the bytes in flight."""
        self._wire.clear()


class CanChannel(Channel):
    """Frames of 16 bytes over a bus; a damaged one is sent again by its controller.

    A frame takes the time of its worst stuffing. The adapter's latency is a delay; frames of
    the other direction are not waited for (the bus is a few per cent full).
    """

    def __init__(
        self, bitrate: int, latency_us: int, damage: Callable[[bytes], list[bytes] | None]
    ) -> None:
        """``damage`` gives what becomes of a frame: None, it is destroyed and sent again."""
        super().__init__()
        self._bitrate = bitrate
        self._latency_us = latency_us
        self._damage = damage
        self._queue: deque[bytes] = deque()
        self._sent_us = 0
        """When the frame at the head will have been sent."""
        self._arriving: deque[tuple[int, bytes]] = deque()

    def push(self, data: bytes, now_us: int) -> None:
        """Queue frames; what finds no room is lost."""
        self._run(now_us)
        for start in range(0, len(data) - RECORD.size + 1, RECORD.size):
            record = data[start : start + RECORD.size]
            if len(self._queue) >= CAN_QUEUE:
                self.overrun += RECORD.size
                continue
            if not self._queue:
                self._sent_us = max(now_us, self._sent_us) + self._duration_us(record)
            self._queue.append(record)

    def pull(self, now_us: int) -> bytes:
        """Fetch the frames that have arrived."""
        self._run(now_us)
        data = b""
        while self._arriving and self._arriving[0][0] <= now_us:
            data += self._arriving.popleft()[1]
        return data

    def next_us(self) -> int | None:
        """When a frame arrives, or has been sent."""
        times = [self._sent_us] if self._queue else []
        if self._arriving:
            times.append(self._arriving[0][0])
        return min(times, default=None)

    def room(self) -> int:
        """Bytes of the frames that still fit."""
        return (CAN_QUEUE - len(self._queue)) * RECORD.size

    def clear(self) -> None:
        """Drop the bytes in flight."""
        self._queue.clear()
        self._arriving.clear()

    def _run(self, now_us: int) -> None:
        while self._queue and self._sent_us <= now_us:
            outcome = self._damage(self._queue[0])
            if outcome is not None:
                self._queue.popleft()
                self._arriving += [(self._sent_us + self._latency_us, r) for r in outcome]
            if self._queue:
                self._sent_us += self._duration_us(self._queue[0])

    def _duration_us(self, record: bytes) -> int:
        return -(-worst_bits(min(record[4], 8)) * _US // self._bitrate)
