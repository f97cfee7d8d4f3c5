"""A virtual sweeper with a serial line and faults, and a session that drives it; virtual time."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from bridge.session.session import Session
from bridge.session.states import Data, Ping, SessionReady, State
from protocol.clock import HostNs
from protocol.messages.device import Imu
from protocol.messages.values import Mode, StopCause
from protocol.uart.link import Link
from sim_device.faults.kinds import parse_fault
from sim_device.line.line import STRAIGHT, LineSettings
from sim_device.rig import Rig
from sim_device.sweeper import Sweeper, VirtualSweeper
from support.sim_body import room

if TYPE_CHECKING:
    from bridge.floor_plan.floor_plan import FloorPlan
    from bridge.session.states import SessionEvent
    from protocol.link import LinkBase
    from protocol.schema.message import Message

E = TypeVar("E")
M = TypeVar("M")
HOST_BOOT_US = 3_000_000
OPEN_FLOOR = room((10.0, 10.0, 0.0))
_SETPOINT_US = 20_000


class Heard(NamedTuple):
    """A received message of the device."""

    at_us: int
    """Arrival: the device's true time, µs."""
    t_us: int
    """Time stamp in the message, µs."""
    message: Message


def rig(
    *faults: str,
    plan: FloorPlan = OPEN_FLOOR,
    settings: LineSettings = STRAIGHT,
    seed: int = 1,
    link: type[LinkBase] = Link,
    device: Sweeper[Any] | None = None,
) -> Rig:
    """Return a noise-free device, by default in the middle of an open floor."""
    device = device or VirtualSweeper(plan, seed=seed, noise="none", link=link)
    return Rig(device, settings, [parse_fault(text) for text in faults], seed=seed)


class Drive:
    """A session that requests one constant velocity whenever it is ready."""

    def __init__(self, made: Rig, v_m_s: float = 0.0, yaw_rate_rad_s: float = 0.0) -> None:
        self.rig = made
        self.velocity = v_m_s, yaw_rate_rad_s
        assert isinstance(made.device, Sweeper)
        self.session = Session(itertools.count(1).__next__, link=made.device.link)
        self.received: list[Heard] = []
        self.events: list[tuple[int, SessionEvent]] = []
        self.bytes: list[tuple[int, bytes]] = []
        """Arrival time and content of received bytes."""
        self.now_us = 0
        self._setpoint_us = 0
        self.session.open(self._host_ns)

    @property
    def _host_ns(self) -> HostNs:
        return HostNs((self.now_us + HOST_BOOT_US) * 1000)

    def run(self, until_s: float) -> None:
        """Run host and device until this time of the device."""
        end_us = round(until_s * 1e6)
        pending = b""
        while self.now_us < end_us:
            deadline_ns = self.session.next_deadline()
            host_us = -(-deadline_ns // 1000) - HOST_BOOT_US if deadline_ns else end_us
            due_us = min(self.rig.next_deadline_us(), host_us, self._setpoint_us, end_us)
            self.now_us = max(self.now_us, due_us) if not pending else self.now_us
            came = self.rig.step(pending, self.now_us)
            if came:
                self.bytes.append((self.now_us, came))
                self._take(self.session.receive(came, self._host_ns))
            self._take(self.session.poll(self._host_ns))
            if self.now_us >= self._setpoint_us:
                self._setpoint_us = self.now_us + _SETPOINT_US
                if self.session.state is State.READY and any(self.velocity):
                    self.session.setpoint(*self.velocity, 200, self._host_ns)
            pending = self.session.data_to_send()

    def _take(self, events: list[SessionEvent]) -> None:
        for event in events:
            self.events.append((self.now_us, event))
            if isinstance(event, Data):
                frame = event.received.frame
                self.received.append(Heard(self.now_us, frame.t_us, event.received.message))
            elif isinstance(event, SessionReady) and any(self.velocity):
                self.session.clear_stop(StopCause.SESSION_END, self._host_ns)
                self.session.set_mode(Mode.VELOCITY, self._host_ns)

    def of(self, kind: type[M], since_s: float = 0.0, until_s: float = 1e9) -> list[M]:
        """Return the messages of one kind that arrived in this interval."""
        return [
            h.message
            for h in self.received
            if isinstance(h.message, kind) and since_s * 1e6 <= h.at_us < until_s * 1e6
        ]

    def round_trips_us(self, since_s: float, until_s: float) -> list[int]:
        """Return the round-trip times of the pings that were answered in this interval, µs."""
        return [
            (e.arrived_ns - e.sent_ns) // 1000
            for at_us, e in self.events
            if isinstance(e, Ping) and since_s * 1e6 <= at_us < until_s * 1e6
        ]

    def negotiated(self) -> list[SessionReady]:
        """Return one event for each complete handshake."""
        return [e for _, e in self.events if isinstance(e, SessionReady)]


def lost_frames(drive: Drive, since_s: float, until_s: float) -> float:
    """Return the share of the inertial samples (100 per second) that did not arrive."""
    return 1.0 - len(drive.of(Imu, since_s, until_s)) / (100 * (until_s - since_s))
