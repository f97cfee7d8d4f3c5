"""Scripts for the C firmware's script board, and the reports of this board.

``sim_device/firmware/board_host/script.c`` defines the format: a script consists of records, and
the board prints one report for each step.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from cobs import cobs

from bridge.motion.robot_model import RobotModel
from protocol.can.frames import RECORD
from protocol.link import Received
from sim_device.device.parameters import table

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from protocol.link import LinkBase

NO_RANGE = 0xFFFF
PARAMETERS = len(table(RobotModel(), node=1))
_BOOT = struct.Struct("<cIBB")
_READINGS = struct.Struct("<c2H7h3HIB4H")
_STEP = struct.Struct("<cIH")
_SUPPLY = struct.Struct("<cH")
REPORTED = struct.Struct(f"<qI3B2HB2hHq2hHq{PARAMETERS}I2h?I")
_STATUS, _TIME_REPLY = 0x11, 0x18
_LOAD = 5
_T16 = 2
"""Size of the time stamp before the payload of a periodic frame on CAN, bytes."""
_STAMP, _HEADER, _CRC = 4, 8, 4


@dataclass(frozen=True, slots=True)
class Boot:
    """Reboot the firmware."""

    boot_id: int = 1
    reset_cause: int = 0
    can: bool = False
    empty_flash: bool = True
    only_wheels_and_imu: bool = False
    misses_periods: bool = False
    """Two of three control periods are missed."""

    def record(self) -> bytes:
        flags = self.can | self.empty_flash << 1
        flags |= self.only_wheels_and_imu << 5 | self.misses_periods << 6
        return _BOOT.pack(b"B", self.boot_id, self.reset_cause, flags)


@dataclass(frozen=True, slots=True)
class Readings:
    """Sensor readings from now on, in the units of ``board.h``."""

    encoders: tuple[int, int] = (0, 0)
    imu: tuple[int, int, int, int, int, int, int] = (0, 0, 16384, 0, 0, 0, 0)
    ultrasonic_mm: int = NO_RANGE
    infrared_dmm: tuple[int, int] = (NO_RANGE, NO_RANGE)
    contacts: int = 0
    battery_mv: int = 15_803
    logic_mv: int = 5_003
    motors_ma: tuple[int, int] = (57, 63)
    ultrasonic_age_us: int = 0
    encoders_frozen: bool = False
    """The encoders have no new sample from now on."""

    def record(self) -> bytes:
        return _READINGS.pack(
            b"R",
            *(count & 0xFFFF for count in self.encoders),
            *self.imu,
            self.ultrasonic_mm,
            *self.infrared_dmm,
            self.ultrasonic_age_us,
            self.contacts | self.encoders_frozen << 3,
            self.battery_mv,
            self.logic_mv,
            *self.motors_ma,
        )


@dataclass(frozen=True, slots=True)
class Step:
    """Run the firmware for a time, then pass received data to it."""

    for_us: int
    data: bytes = b""

    def record(self) -> bytes:
        return _STEP.pack(b"S", self.for_us, len(self.data)) + self.data


@dataclass(frozen=True, slots=True)
class LoseSupply:
    """Interrupt the supply ``periods`` control periods after the next save to flash begins."""

    periods: int

    def record(self) -> bytes:
        return _SUPPLY.pack(b"P", self.periods)


Act = Boot | Readings | Step | LoseSupply


def script(acts: Iterable[Act]) -> bytes:
    """Return the script as bytes."""
    return b"".join(act.record() for act in acts)


class Held(NamedTuple):
    """Setpoint in a watchdog, in wire steps; ``counter`` is 256 before the first setpoint."""

    first: int
    second: int
    counter: int
    until_us: int


class Reported(NamedTuple):
    """State and output of the firmware at the end of a step."""

    now_us: int
    session_id: int
    negotiated: bool
    state: int
    """State as numbered in ``modes.h``: stopped, idle, velocity, bring-up, onboard, running,
    paused.
    """
    stop_cause: int
    faults: int
    stale: int
    reboots: int
    setpoint: Held
    duty: Held
    parameters: tuple[int, ...]
    motors: tuple[int, int]
    drivers: bool
    wrote: bytes


def read(data: bytes) -> list[Reported]:
    """Parse the program's output."""
    reported: list[Reported] = []
    at = 0
    while at < len(data):
        values = REPORTED.unpack_from(data, at)
        at += REPORTED.size
        now_us, session_id, negotiated, state, stop_cause, faults, stale, reboots = values[:8]
        left, right, drivers, length = values[-4:]
        reported.append(
            Reported(
                now_us,
                session_id,
                bool(negotiated),
                state,
                stop_cause,
                faults,
                stale,
                reboots,
                Held(*values[8:12]),
                Held(*values[12:16]),
                values[16:-4],
                (left, right),
                drivers,
                data[at : at + length],
            )
        )
        at += length
    return reported


def received(reports: Iterable[Reported], link: LinkBase) -> list[Received]:
    """Return the messages that the firmware sent, as the host's link receives them."""
    events = [event for report in reports for event in link.receive(report.wrote, report.now_us)]
    return [event for event in events if isinstance(event, Received)]


def frames(wrote: bytes, *, can: bool = False) -> Sequence[bytes]:
    """Return the output frame by frame, with two values removed.

    The load in ``status`` is measured by one firmware and assumed by the other. The sending time in
    a time reply is that of the line in C; on the script board it is a microsecond later if a frame
    waits.
    """
    if can:
        return [_can_frame(wrote[i : i + RECORD.size]) for i in range(0, len(wrote), RECORD.size)]
    return [_uart_frame(piece) for piece in wrote.split(b"\0")]


def _uart_frame(piece: bytes) -> bytes:
    if not piece:
        return piece
    body: bytes = cobs.decode(piece)
    if body[2] == _STATUS:
        return body[: _HEADER + _LOAD] + body[_HEADER + _LOAD + 1 : -_CRC]
    if body[2] == _TIME_REPLY:
        sent_us, came_us = (
            int.from_bytes(body[i : i + 4], "little") for i in (_STAMP, _HEADER + 1)
        )
        assert (sent_us - came_us) & 0xFFFF_FFFF <= 1
        return body[:_STAMP] + body[_HEADER:-_CRC]
    return piece


def _can_frame(record: bytes) -> bytes:
    if int.from_bytes(record[:4], "little") >> 4 != _STATUS:
        return record
    load = 8 + _T16 + _LOAD
    return record[:load] + record[load + 1 :]
