"""Frames between the emulated chip and the plant, over the chip's second UART.

A frame consists of 0xA5, type, payload length, payload and CRC-32 (as in zlib, from type to
payload). All numbers are little-endian. The chip's end is
``firmware/board_f405_qemu/plant_link.h``, which defines the same numbers. This module has no clock
and no socket.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple
from zlib import crc32

from sim_device.core.core_firmware import PAGE_SIZE, PAGES
from sim_device.sensors.units import contact_bits, milli, range_steps

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sim_device.sensors.contacts import Bumpers
    from sim_device.sensors.imu import ImuCounts
    from sim_device.sensors.power_monitor import PowerReading
    from sim_device.sensors.rangers import Ranges

VERSION = 3
"""Version of the link to the plant; emulator and chip must have the same."""
CHUNK = 128
"""Number of flash bytes in a frame."""
_SYNC = 0xA5
_HEAD = struct.Struct("<BBB")
_CHECK = struct.Struct("<I")
_REQUEST = struct.Struct("<IIIhhH?")
_MOTORS = struct.Struct("<Ihh?")
_SAMPLE = struct.Struct("<IHH7hHHHBII")
_POWER = struct.Struct("<IHHHH")
_BYTE = struct.Struct("<B")
_PLACE = struct.Struct("<BH")
_IDENTITY = struct.Struct("<12sIBBB")


class FromChip(IntEnum):
    """Types of the chip's frames."""

    BOOT = 0x01
    REQUEST = 0x02
    MOTORS = 0x03
    ERASE = 0x04
    WRITE = 0x05
    RESET = 0x06


class ToChip(IntEnum):
    """Types of the plant's frames."""

    IDENTITY = 0x81
    PAGE = 0x82
    SAMPLE = 0x83
    POWER = 0x84
    HANG = 0x85
    CRASH = 0x86


class ChipBoot(NamedTuple):
    """The chip has started and requests its identity."""

    version: int


class PlantRequest(NamedTuple):
    """Request for the readings at ``sample_us``; the plant may advance to this time."""

    now_us: int
    """Present time of the chip's clock, µs; 32 bits, as all times of the chip."""
    sample_us: int
    newest_us: int
    """Time of the last readings that the chip has received, µs."""
    left: int
    """Left duty, in units of ``DUTY_ONE``."""
    right: int
    stack_free: int
    """Number of bytes of the chip's stack that have never been used."""
    drivers: bool
    """True if the motor drivers are enabled."""


class Motors(NamedTuple):
    """Change of the duties, or of the enabled state of the motor drivers."""

    now_us: int
    left: int
    right: int
    drivers: bool


class Erase(NamedTuple):
    """The chip erases a page of flash."""

    page: int


class Write(NamedTuple):
    """The chip writes bytes to a page of flash."""

    page: int
    offset: int
    data: bytes


class ChipReset(NamedTuple):
    """The chip is about to reset; ``cause`` is the reason."""

    cause: int


Message = ChipBoot | PlantRequest | Motors | Erase | Write | ChipReset


def frame(kind: int, payload: bytes = b"") -> bytes:
    """Return the bytes of a frame."""
    body = bytes((kind, len(payload))) + payload
    return bytes((_SYNC,)) + body + _CHECK.pack(crc32(body))


def identity(uid: bytes, boot_id: int, cause: int, node: int, chunks: int) -> bytes:
    """Return the identity frame; ``chunks`` is the number of flash frames sent before it."""
    return frame(ToChip.IDENTITY, _IDENTITY.pack(uid, boot_id, cause, node, chunks))


def pages(content: Sequence[bytes | bytearray]) -> list[bytes]:
    """Return the frames that fill the chip's copy of its flash, without frames for erased parts."""
    frames = []
    for number, page in enumerate(content):
        used = len(bytes(page).rstrip(b"\xff"))
        for offset in range(0, used, CHUNK):
            data = bytes(page[offset : min(used, offset + CHUNK)])
            frames.append(frame(ToChip.PAGE, _PLACE.pack(number, offset) + data))
    return frames


def sample(  # noqa: PLR0913 - all that is sampled together
    at_us: int,
    counts: tuple[int, int],
    imu: ImuCounts,
    ranges: Ranges,
    bumpers: Bumpers,
    *,
    cliff: bool,
    imu_age_us: int,
) -> bytes:
    """Return the frame with the readings of one control period, at ``at_us`` of the chip's clock.

    The IMU's sample is ``imu_age_us`` older.
    """
    payload = _SAMPLE.pack(
        at_us & 0xFFFF_FFFF,
        *counts,
        *imu,
        range_steps(ranges.ultrasonic_m, 1e3),
        range_steps(ranges.infrared_left_m, 1e4),
        range_steps(ranges.infrared_right_m, 1e4),
        contact_bits(bumpers, cliff=cliff),
        imu_age_us,
        ranges.ultrasonic_age_us,
    )
    return frame(ToChip.SAMPLE, payload)


def power(at_us: int, reading: PowerReading) -> bytes:
    """Return the frame with rail voltages, mV, and absolute motor currents, mA."""
    return frame(ToChip.POWER, _POWER.pack(at_us & 0xFFFF_FFFF, *map(milli, reading)))


class Parser:
    """Parses the chip's bytes into frames; damaged frames are skipped and counted."""

    def __init__(self) -> None:
        self._data = bytearray()
        self.damaged = 0
        """Number of frames with a wrong CRC or with invalid content."""

    def clear(self) -> None:
        """Drop an incomplete frame, because the chip restarts."""
        self._data.clear()

    def feed(self, data: bytes) -> Iterator[Message]:
        """Process received bytes; yield the completed messages."""
        self._data += data
        while (start := self._data.find(_SYNC)) >= 0:
            del self._data[:start]
            if len(self._data) < _HEAD.size:
                return
            _, kind, length = _HEAD.unpack_from(self._data)
            end = _HEAD.size + length
            if len(self._data) < end + _CHECK.size:
                return
            body, payload = bytes(self._data[1:end]), bytes(self._data[_HEAD.size : end])
            if _CHECK.unpack_from(self._data, end)[0] != crc32(body):
                self.damaged += 1
                del self._data[:1]
                continue
            del self._data[: end + _CHECK.size]
            message = _message(kind, payload)
            if message is None:
                self.damaged += 1
            else:
                yield message
        self._data.clear()


def _write(payload: bytes) -> Write:
    page, offset = _PLACE.unpack_from(payload)
    return Write(page, offset, payload[_PLACE.size :])


_READERS: dict[int, Callable[[bytes], Message]] = {
    FromChip.BOOT: lambda payload: ChipBoot(*_BYTE.unpack(payload)),
    FromChip.REQUEST: lambda payload: PlantRequest(*_REQUEST.unpack(payload)),
    FromChip.MOTORS: lambda payload: Motors(*_MOTORS.unpack(payload)),
    FromChip.ERASE: lambda payload: Erase(*_BYTE.unpack(payload)),
    FromChip.WRITE: _write,
    FromChip.RESET: lambda payload: ChipReset(*_BYTE.unpack(payload)),
}


def _message(kind: int, payload: bytes) -> Message | None:
    """Return a message; None for an unknown type, a wrong length or an invalid flash address."""
    reader = _READERS.get(kind)
    if reader is None:
        return None
    try:
        message = reader(payload)
    except struct.error:
        return None
    if isinstance(message, Erase | Write) and message.page >= PAGES:
        return None
    if isinstance(message, Write) and message.offset + len(message.data) > PAGE_SIZE:
        return None
    return message
