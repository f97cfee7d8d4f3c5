"""Timing of the link between device and host: UART, USB adapter, CAN bus, and their buffers.

A channel models one direction; it has no I/O and no clock. :meth:`Channel.push` sends bytes at a
given time, and :meth:`Channel.pull` returns the bytes that have arrived by a given time.
:meth:`Channel.next_us` returns the time of the next arrival. Times are microseconds since power-on
of the device and never decrease.

The model from device to host has three parts: the device's transmit buffer, the UART with 10 bits
per byte (8N1), and the adapter. The adapter delivers its data when it has 62 bytes (a 64-byte USB
packet minus two status bytes) or when its latency timer expires. The timer restarts at each
delivery and then fires periodically (FTDI AN232B-04). The model from host to device has two parts:
the adapter's buffer and the UART. USB flow control blocks a host that writes faster, so no byte is
lost. :class:`sim_device.rig.Rig` models the adapter's buffer for a host that does not read.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocol.can.frames import RECORD, worst_bits
from sim_device.line.can_controller import RECOVERY_BITS

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_device.line.can_controller import CanController

DEFAULT_BAUD = 921_600
DEFAULT_LATENCY_US = 1_000
DEFAULT_BITRATE = 500_000
BITS_PER_BYTE = 10
"""Number of bits per byte on the UART, 8N1: start, eight data bits, stop."""
PACKET = 62
FIFO_BYTES = 4096
"""Size of an adapter's buffer per direction, bytes (FT232H: 1 KiB, FT2232H: 4 KiB)."""
TRANSMIT_BYTES = 4096
"""Size of the device's buffer for bytes that wait for the UART, bytes."""
CAN_QUEUE = 64
"""Maximum number of frames that wait for the bus, in the controller's mailboxes and the driver's
queue.
"""
CONTROLLER_FRAMES = 7
"""Number of frames that the firmware can no longer reorder: three in the controller's mailboxes,
and four in the board's driver (``stm32f429/can.c``)."""
NO_LIMIT = 0xFFFF_FFFF
"""Free space of a link without a limit (``CHIP_NO_LIMIT`` of ``chip.h``)."""
_US = 1_000_000
_CHUNK = 64
"""Maximum number of bytes after which the device reads its receive buffer: half of a DMA ring
buffer."""


@dataclass(frozen=True, slots=True)
class LineSettings:
    """Settings of the link; the defaults are a USB serial adapter in low-latency mode."""

    baud: int = DEFAULT_BAUD
    """Baud rate of the UART, bit/s; 0: bytes need no time."""
    latency_us: int = DEFAULT_LATENCY_US
    """Latency timer of the adapter, µs; 0: no adapter. Data then arrives when the UART becomes
    idle.
    """
    bitrate: int = 0
    """Bit rate of a CAN bus, bit/s, which replaces ``baud``; 0: no bus."""


STRAIGHT = LineSettings(0, 0)
"""Settings of a link without delay or limit, for tests and for callers with their own link
model."""


class Channel(ABC):
    """One direction of a link."""

    def __init__(self) -> None:
        self.overrun = 0
        """Number of bytes lost because the buffer at the sending end was full."""
        self.dropped = 0
        """Number of frames that lost bytes because the buffer was full."""

    @abstractmethod
    def push(self, data: bytes, now_us: int) -> None:
        """Send bytes into the channel."""

    @abstractmethod
    def pull(self, now_us: int) -> bytes:
        """Return the bytes that have arrived at the receiving end by ``now_us``."""

    @abstractmethod
    def next_us(self) -> int | None:
        """Time of the next arrival, µs; ``None``: no data is on its way."""

    @abstractmethod
    def clear(self) -> None:
        """Drop the bytes on their way, as if the cable were unplugged."""

    def room(self) -> int:
        """Return the number of bytes that can be pushed now without loss."""
        return FIFO_BYTES

    def space(self, now_us: int) -> int:  # noqa: ARG002 - a line that takes everything has no clock
        """Return how much a chip can send now without loss: bytes, or frames on a CAN bus."""
        return NO_LIMIT


class StraightChannel(Channel):
    """A channel without delay."""

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
        """Return the bytes."""
        if now_us < self._at_us:
            return b""
        data, self._data = self._data, b""
        return data

    def next_us(self) -> int | None:
        """Return the time of the newest bytes, or None without bytes."""
        return self._at_us if self._data else None

    def clear(self) -> None:
        """Drop the bytes."""
        self._data = b""


class UartTransmitter:
    """A UART's transmit queue and shift register, exact to the microsecond."""

    def __init__(self, baud: int, capacity: int) -> None:
        self._baud = baud
        self._capacity = capacity
        self._waiting = bytearray()
        self._began_us = 0
        self._sent = 0
        """Number of bytes sent since ``_began_us``, the last time at which the UART was idle."""
        self.overrun = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def room(self) -> int:
        """Return the number of bytes that still fit."""
        return self._capacity - len(self._waiting)

    def put(self, data: bytes, now_us: int) -> None:
        """Queue the bytes that fit; count and drop the rest. Call :meth:`take` before."""
        if not self._waiting and data and now_us >= self.after_us(0):
            self._began_us, self._sent = now_us, 0
        room = self.room
        if len(data) > room:
            self.overrun += len(data) - room
            data = data[:room]
        self._waiting += data

    def left_by(self, now_us: int) -> int:
        """Return the number of queued bytes that are sent by ``now_us``."""
        sent = (now_us - self._began_us) * self._baud // (BITS_PER_BYTE * _US)
        return min(len(self._waiting), max(0, sent - self._sent))

    def after_us(self, count: int) -> int:
        """Return the time at which ``count`` more bytes will be sent, rounded up."""
        bits = (self._sent + count) * BITS_PER_BYTE * _US
        return self._began_us + -(-bits // self._baud)

    def take(self, now_us: int, limit: int | None = None) -> bytes:
        """Return the bytes that are sent by ``now_us``, at most ``limit``."""
        if not self._waiting:
            return b""
        count = self.left_by(now_us)
        if limit is not None:
            count = min(count, max(0, limit))
        data = bytes(self._waiting[:count])
        del self._waiting[:count]
        self._sent += count
        return data

    def clear(self) -> None:
        """Drop the queue."""
        self._waiting.clear()


class UartUp(Channel):
    """Channel from device to host: transmit buffer, UART, adapter with its latency timer."""

    def __init__(self, baud: int, latency_us: int, damage: Callable[[bytes], bytes]) -> None:
        super().__init__()
        self._transmitter = UartTransmitter(baud, TRANSMIT_BYTES)
        self._latency_us = latency_us
        self._damage = damage
        self._packet = bytearray()
        self._handed = bytearray()
        self._timer_us = 0
        """Reference time of the latency timer, µs; it fires every ``latency_us`` after this
        time."""

    def push(self, data: bytes, now_us: int) -> None:
        """Put bytes into the device's transmit buffer."""
        self._run(now_us)
        if len(data) > self._transmitter.room:
            self.dropped += sum(map(bool, data[self._transmitter.room :].split(b"\0")))
        self._transmitter.put(data, now_us)
        self.overrun = self._transmitter.overrun

    def pull(self, now_us: int) -> bytes:
        """Return the bytes that the adapter has delivered."""
        self._run(now_us)
        data = bytes(self._handed)
        self._handed.clear()
        return data

    def next_us(self) -> int | None:
        """Return the time of the adapter's next delivery."""
        if self._handed:
            return self._timer_us
        return self._next_packet_us()

    def clear(self) -> None:
        """Drop the bytes in flight."""
        self._transmitter.clear()
        self._packet.clear()
        self._handed.clear()

    def space(self, now_us: int) -> int:
        """Return the number of bytes that fit the transmit buffer now."""
        return self._transmitter.room + self._transmitter.left_by(now_us)

    def _next_packet_us(self) -> int | None:
        waiting = len(self._transmitter)
        if not waiting and not self._packet:
            return None
        missing = max(0, PACKET - len(self._packet))
        full_us = self._transmitter.after_us(missing) if waiting >= missing else None
        if self._latency_us == 0:
            return full_us if full_us is not None else self._transmitter.after_us(waiting)
        first_us = self._transmitter.after_us(0 if self._packet else 1)
        timer_us = self._fires_us(max(first_us, self._timer_us + 1))
        return timer_us if full_us is None else min(full_us, timer_us)

    def _fires_us(self, at_least_us: int) -> int:
        """Return the first time, not before ``at_least_us``, at which the timer fires."""
        periods = -(-(at_least_us - self._timer_us) // self._latency_us)
        return self._timer_us + periods * self._latency_us

    def _run(self, now_us: int) -> None:
        while (at_us := self._next_packet_us()) is not None and at_us <= now_us:
            self._packet += self._damage(self._transmitter.take(at_us, PACKET - len(self._packet)))
            self._handed += self._packet
            self._packet.clear()
            self._timer_us = at_us
        self._packet += self._damage(self._transmitter.take(now_us))


class UartDown(Channel):
    """Channel from host to device: the adapter's buffer and the UART.

    The device receives the bytes when the UART becomes idle, and after every 64 bytes.
    """

    def __init__(self, baud: int, damage: Callable[[bytes], bytes]) -> None:
        super().__init__()
        self._transmitter = UartTransmitter(baud, FIFO_BYTES)
        self._damage = damage

    def push(self, data: bytes, now_us: int) -> None:
        """Send bytes to the adapter; :meth:`room` is its free space."""
        self._transmitter.put(data, now_us)
        self.overrun = self._transmitter.overrun

    def pull(self, now_us: int) -> bytes:
        """Return the bytes that the device has received by ``now_us``."""
        data = self._transmitter.take(now_us)
        return self._damage(data) if data else b""

    def next_us(self) -> int | None:
        """Return the time of the device's next receive interrupt."""
        waiting = len(self._transmitter)
        return self._transmitter.after_us(min(waiting, _CHUNK)) if waiting else None

    def room(self) -> int:
        """Return the free space of the adapter, bytes."""
        return self._transmitter.room

    def clear(self) -> None:
        """Drop the bytes in flight."""
        self._transmitter.clear()


class CanChannel(Channel):
    """A channel of frames (16 bytes each) over a CAN bus; the controller repeats a damaged frame.

    The transmission time of a frame includes worst-case bit stuffing. The adapter's latency is
    added as a delay. The model ignores delays by frames of the other direction, because the bus
    load is only a few per cent.
    """

    def __init__(
        self,
        bitrate: int,
        latency_us: int,
        damage: Callable[[bytes], list[bytes] | None],
        *,
        sends: CanController | None = None,
        receives: CanController | None = None,
    ) -> None:
        """Create the channel.

        ``damage`` returns the frames that arrive when a frame is sent; None: the frame is destroyed
        and sent again. ``sends`` and ``receives`` count frames and errors in the device's
        controller.
        """
        super().__init__()
        self._sends, self._receives = sends, receives
        self._bitrate = bitrate
        self._latency_us = latency_us
        self._damage = damage
        self._queue: deque[bytes] = deque()
        self._sent_us = 0
        """Time at which the transmission of the first frame in the queue ends, µs."""
        self._arriving: deque[tuple[int, bytes]] = deque()

    def push(self, data: bytes, now_us: int) -> None:
        """Queue frames; frames that do not fit are lost."""
        self._run(now_us)
        for start in range(0, len(data) - RECORD.size + 1, RECORD.size):
            record = data[start : start + RECORD.size]
            if len(self._queue) >= CAN_QUEUE:
                self.overrun += RECORD.size
                self.dropped += 1
                continue
            if not self._queue:
                self._sent_us = max(now_us, self._sent_us) + self._duration_us(record)
            self._queue.append(record)

    def pull(self, now_us: int) -> bytes:
        """Return the frames that have arrived."""
        self._run(now_us)
        data = b""
        while self._arriving and self._arriving[0][0] <= now_us:
            data += self._arriving.popleft()[1]
        return data

    def next_us(self) -> int | None:
        """Return the time at which the next frame arrives, or its transmission ends."""
        times = [self._sent_us] if self._queue else []
        if self._arriving:
            times.append(self._arriving[0][0])
        return min(times, default=None)

    def room(self) -> int:
        """Return the free space in bytes, for whole frames."""
        return (CAN_QUEUE - len(self._queue)) * RECORD.size

    def space(self, now_us: int) -> int:
        """Return the number of frames that the controller accepts now."""
        self._run(now_us)
        return max(0, CONTROLLER_FRAMES - len(self._queue))

    def clear(self) -> None:
        """Drop the bytes in flight."""
        self._queue.clear()
        self._arriving.clear()

    def _run(self, now_us: int) -> None:
        while self._queue and self._sent_us <= now_us:
            outcome = self._damage(self._queue[0])
            self._count(good=outcome is not None)
            if outcome is not None:
                self._queue.popleft()
                self._arriving += [(self._sent_us + self._latency_us, r) for r in outcome]
            if self._queue:
                self._sent_us += self._duration_us(self._queue[0])

    def _count(self, *, good: bool) -> None:
        """Count a frame in the device's controller; schedule its return after bus-off."""
        if self._receives is not None:
            self._receives.received(good=good)
        sender = self._sends
        if sender is not None:
            was_off = sender.is_off
            sender.sent(good=good)
            if sender.is_off and not was_off:
                self._sent_us += RECOVERY_BITS * _US // self._bitrate
                sender.rejoin()

    def _duration_us(self, record: bytes) -> int:
        return -(-worst_bits(min(record[4], 8)) * _US // self._bitrate)
