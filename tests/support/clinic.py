"""Patients for the doctor: a virtual sweeper with one trouble, and what the line carried.

Two kinds of visit, both in virtual time. ``listen``: a host that agrees, asks the time and
records, and moves nothing. ``drive``: a whole run with a planner, recorded.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bridge.doctor import Examination
from bridge.motion.robot_model import RobotModel
from bridge.session import Session
from bridge.session_events import Agreed, Failed
from bridge.telemetry import EventRecord, RawBytes
from protocol.clock import HostNs
from sim_device.device import VirtualSweeper
from sim_device.faults.kinds import parse_fault
from sim_device.line import LineSettings
from sim_device.rig import Rig
from tools.rooms import load_room
from tools.virtual_run import run_virtual

if TYPE_CHECKING:
    from bridge.telemetry import Record
    from protocol.catalogue import Catalogue

BOOT_US = 7_000_000
READ_US = 200
"""How soon a host that is not held up reads what has come."""


@dataclass
class Visit:
    """What is wrong, and how the doctor sees it."""

    name: str
    faults: tuple[str, ...] = ()
    line: LineSettings = field(default_factory=LineSettings)
    seconds: float = 20.0
    moving: bool = False
    stalls: tuple[tuple[float, float], ...] = ()
    """When the host reads nothing, and for how long (s)."""
    catalogue: Catalogue | None = None
    """What the device declares; None: what we do."""
    room: str = "case-1"
    noise: str = "typical"


def examine(visit: Visit, seed: int) -> Examination:
    """One visit."""
    return _drive(visit, seed) if visit.moving else _listen(visit, seed)


class _Recorder:
    """A sink that shows raw bytes and port events to the doctor."""

    def __init__(self) -> None:
        self.examination = Examination()

    def write(self, record: Record) -> None:
        if isinstance(record, RawBytes):
            take = self.examination.sent if record.outgoing else self.examination.received
            take(record.data, record.log_ns)
        elif isinstance(record, EventRecord) and record.kind == "port_lost":
            self.examination.port_lost.append(record.text)

    def close(self) -> None:
        """Nothing is open."""


def _drive(visit: Visit, seed: int) -> Examination:
    recorder = _Recorder()
    run_virtual(
        load_room(visit.room),
        RobotModel(),
        "recovery",
        recorder,
        seed=seed,
        noise=visit.noise,
        max_time_s=visit.seconds,
        faults=[parse_fault(text) for text in visit.faults],
        line=visit.line,
    )
    return recorder.examination


def _listen(visit: Visit, seed: int) -> Examination:
    catalogue = {} if visit.catalogue is None else {"catalogue": visit.catalogue}
    device = VirtualSweeper(load_room(visit.room), seed=seed, noise=visit.noise, **catalogue)
    faults = [parse_fault(text) for text in visit.faults]
    rig = Rig(device, visit.line, faults, seed=seed)
    session = Session(itertools.count(0x5EED + seed).__next__)
    examination = Examination()
    now_us, end_us = 0, round(visit.seconds * 1e6)
    pending = waiting = b""
    read_us: int | None = None

    def host_ns() -> HostNs:
        return HostNs((now_us + BOOT_US) * 1000)

    session.open(host_ns())
    while now_us < end_us:
        deadline_ns = session.next_deadline()
        held_until = next(
            (round(1e6 * (at + lasts)) for at, lasts in visit.stalls if at <= now_us / 1e6 < at + lasts),
            None,
        )
        host_us = end_us if deadline_ns is None else -(-deadline_ns // 1000) - BOOT_US
        moments = [rig.next_deadline_us(), end_us, host_us if held_until is None else held_until]
        if read_us is not None:
            moments.append(read_us)
        now_us = max(now_us, min(moments)) if not pending else now_us
        came = rig.step(pending, now_us)
        pending = b""
        if came:
            waiting += came
            read_us = read_us or now_us + READ_US
        held = any(at <= now_us / 1e6 < at + lasts for at, lasts in visit.stalls)
        if held:
            read_us = round(1e6 * max(at + lasts for at, lasts in visit.stalls if at <= now_us / 1e6))
            continue
        if read_us is not None and now_us >= read_us:
            examination.received(waiting, host_ns())
            events = session.receive(waiting, host_ns())
            waiting, read_us = b"", None
        else:
            events = []
        for event in [*events, *session.poll(host_ns())]:
            if isinstance(event, Agreed):
                examination.differences = [d.report() for d in event.differences]
            elif isinstance(event, Failed):
                examination.failure = event.kind, event.text
        pending = session.data_to_send()
        if pending:
            examination.sent(pending, host_ns())
    return examination
