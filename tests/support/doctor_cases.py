"""Test cases for the doctor: a virtual sweeper with one fault, and the bytes on its line.

There are two kinds of case, both in virtual time. ``listen``: a host completes the handshake,
requests the time and records, but moves nothing. ``drive``: a whole run with a planner is recorded.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bridge.doctor import Examination
from bridge.doctor.live_examination import LiveExamination
from bridge.motion.robot_model import RobotModel
from bridge.session.records import EventRecord, RawBytes, RawCan
from protocol.can.frames import RECORD
from protocol.can.link import CanLink
from protocol.clock import HostNs
from protocol.link import Medium
from protocol.schema.catalogue import CATALOGUE
from protocol.uart.link import Link
from sim_device.faults.kinds import parse_fault
from sim_device.line.line import LineSettings
from sim_device.rig import Rig
from sim_device.sweeper import VirtualSweeper
from tools.cli.rooms import load_room
from tools.virtual.run import run_virtual

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bridge.session.records import Record
    from protocol.schema.catalogue import Catalogue

BOOT_US = 7_000_000
READ_US = 200
"""Time after which an undelayed host reads the received bytes, µs."""


@dataclass
class DoctorCase:
    """One fault, and how the doctor examines it."""

    name: str
    faults: tuple[str, ...] = ()
    line: LineSettings = field(default_factory=LineSettings)
    seconds: float = 20.0
    moving: bool = False
    stalls: tuple[tuple[float, float], ...] = ()
    """Intervals in which the host reads nothing: start and duration, s."""
    catalogue: Catalogue | None = None
    """Message declarations of the device; None: those of this version."""
    room: str = "case-1"
    noise: str = "typical"

    @property
    def can(self) -> bool:
        """True if the examination uses a CAN bus."""
        return self.line.bitrate > 0


def examine(case: DoctorCase, seed: int) -> Examination:
    """Run one case and return its examination."""
    return _drive(case, seed) if case.moving else _listen(case, seed)


class _Recorder:
    """A sink that passes raw bytes and port events to the doctor."""

    def __init__(self, medium: Medium) -> None:
        self.examination = Examination(medium)

    def write(self, record: Record) -> None:
        if isinstance(record, RawBytes | RawCan):
            take = self.examination.sent if record.outgoing else self.examination.received
            data = record.data
            if isinstance(record, RawCan):
                data = RECORD.pack(record.can_id, len(data), data)
            take(data, record.log_ns)
        elif isinstance(record, EventRecord) and record.kind == "port_lost":
            self.examination.port_lost.append(record.text)

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Do nothing: there is nothing to close."""


def _drive(case: DoctorCase, seed: int) -> Examination:
    recorder = _Recorder(Medium.CAN if case.can else Medium.UART)
    run_virtual(
        load_room(case.room),
        RobotModel(),
        "recovery",
        recorder,
        seed=seed,
        noise=case.noise,
        max_time_s=case.seconds,
        faults=[parse_fault(text) for text in case.faults],
        line=case.line,
        link=CanLink if case.can else Link,
    )
    return recorder.examination


class _VirtualPort:
    """A host that examines a device in virtual time, and that may stall."""

    def __init__(self, case: DoctorCase, seed: int) -> None:
        link = CanLink if case.can else Link
        device = VirtualSweeper(
            load_room(case.room),
            link=link,
            seed=seed,
            noise=case.noise,
            catalogue=case.catalogue or CATALOGUE,
        )
        faults = [parse_fault(text) for text in case.faults]
        self._rig = Rig(device, case.line, faults, seed=seed)
        self._stalls = [(round(1e6 * at), round(1e6 * (at + lasts))) for at, lasts in case.stalls]
        self._end_us = round(case.seconds * 1e6)
        self.doctor = LiveExamination(itertools.count(0x5EED + seed).__next__, link=link)
        self._now_us = 0
        self._waiting = b""
        self._read_us: int | None = None
        """Time at which the waiting bytes are read, µs."""

    @property
    def _host_ns(self) -> HostNs:
        return HostNs((self._now_us + BOOT_US) * 1000)

    def _free_us(self, at_us: int) -> int:
        """Return the first time from ``at_us`` on at which the host does not stall."""
        return max([at_us, *(end for begin, end in self._stalls if begin <= at_us < end)])

    def run(self) -> None:
        """Run to the case's end."""
        doctor, rig = self.doctor, self._rig
        doctor.open(self._host_ns)
        pending = b""
        while self._now_us < self._end_us:
            if not pending:
                self._now_us = max(self._now_us, self._next_us())
            came = rig.step(pending, self._now_us)
            pending = b""
            if came:
                self._waiting += came
                self._read_us = self._read_us or self._now_us + READ_US
            if self._free_us(self._now_us) > self._now_us:
                continue
            if self._read_us is not None and self._now_us >= self._read_us:
                doctor.receive(self._waiting, self._host_ns)
                self._waiting, self._read_us = b"", None
            pending = doctor.data_to_send(self._host_ns)

    def _next_us(self) -> int:
        deadline_ns = self.doctor.next_deadline()
        host_us = self._end_us if deadline_ns is None else -(-deadline_ns // 1000) - BOOT_US
        wants = [host_us] if self._read_us is None else [host_us, self._read_us]
        free = [self._free_us(max(at_us, self._now_us)) for at_us in wants]
        return min(self._rig.next_deadline_us(), self._end_us, *free)


def _listen(case: DoctorCase, seed: int) -> Examination:
    virtual_port = _VirtualPort(case, seed)
    virtual_port.run()
    return virtual_port.doctor.examination
