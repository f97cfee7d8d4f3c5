"""Both ends of a wire in virtual time: a host or session, and a virtual sweeper."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from bridge.coverage.planner import ScriptedPlanner
from bridge.coverage.runner import PlanRunner
from bridge.motion.geometry import wrap_angle
from bridge.motion.legs import Turn
from bridge.motion.robot_model import RobotModel
from bridge.run.host import Host
from bridge.run.mission import Mission
from bridge.run.options import HostOptions
from bridge.session.parameters import Parameter
from bridge.session.session import Session
from protocol.authentication import CAN_AUTH_TYPE
from protocol.clock import HostNs
from protocol.link import LinkBase, Received, Rejected
from protocol.messages.device import ParameterValue
from protocol.messages.host import StopAll, VelocitySetpoint
from protocol.messages.values import ResetCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link
from sim_device.sweeper import VirtualSweeper
from support.hostile import Piece, Pipe, Wire
from support.sim_body import room

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bridge.coverage.planner import Script
    from bridge.motion.observation import Observation
    from bridge.session.records import Record
    from bridge.session.states import SessionEvent
    from protocol.schema.catalogue import Catalogue
    from protocol.schema.message import Message

E = TypeVar("E")
R = TypeVar("R")
HOST_BOOT_US = 7_000_000
"""The host's clock at the device's first boot, µs."""
RAMP_US = 450_000
"""Time from the highest speed to rest, µs: 0.3 s of braking at the device's limit of 1 m/s², the
lag of the motors, and one control period.
"""
TIME_TO_LIVE_US = 250_000
REST_M_S = 0.005
REST_RAD_S = 0.02
MAX_STEP_US = 10_000
_session_ids = itertools.count(1)
"""Session ids of all hosts in the tests: each is unique."""
OPEN_FLOOR = room((10.0, 10.0, 0.0))


class Valve(Wire):
    """A simulated wire that a test can cut or hold.

    A cut wire loses all bytes. A held wire stores the bytes, and they arrive together when the hold
    ends.
    """

    def __init__(self, inner: Wire) -> None:
        super().__init__(inner)
        self.cut = False
        self.held = False
        self._kept: list[Piece] = []

    def arrived(self, now_us: int) -> list[Piece]:
        """Return the pieces that may pass, including the pieces that were held before."""
        pieces = self._inside.arrived(now_us)
        if self.cut:
            pieces = []
        self._kept += pieces
        if self.held:
            return []
        kept, self._kept = self._kept, []
        return [Piece(now_us, data) for _, data in kept]

    def next_us(self) -> int | None:
        """Return the time of the next arrival; held pieces have none and leave at the next call."""
        return self._inside.next_us()


class Weather(Wire):
    """A simulated wire with the faults of other wires while ``storming`` is true."""

    def __init__(self, inner: Wire, *storms: Wire) -> None:
        super().__init__(inner)
        self.storming = False
        self._storms = storms

    def misbehave(self, piece: Piece) -> list[Piece]:
        """Pass a piece unchanged, or apply every fault to it."""
        pieces = [piece]
        if self.storming:
            for storm in self._storms:
                pieces = [out for p in pieces for out in storm.misbehave(p)]
        return pieces


class Sent(NamedTuple):
    """A message as the host wrote it to its port."""

    at_us: int
    message: Message


class Collector:
    """A sink that stores every record."""

    def __init__(self) -> None:
        self.records: list[Record] = []

    def write(self, record: Record) -> None:
        self.records.append(record)

    def close(self, summary: object = None) -> None:
        """Do nothing: there is nothing to close."""

    def of(self, kind: type[R]) -> list[R]:
        return [r for r in self.records if isinstance(r, kind)]


class Spinning(ScriptedPlanner):
    """Planner that turns left and right without end, a motion without wall contact."""

    def script(self, obs: Observation) -> Script:
        self.record.change(state="spinning")
        heading = obs.pose.theta_rad
        while True:
            heading = wrap_angle(heading + 2.0)
            yield Turn(heading)


def spinning_host(sink: Collector | None = None, **mission: bool | float) -> Host:
    """Return a host with a planner that never ends."""
    model = RobotModel()
    return Host(
        model,
        sink or Collector(),
        HostOptions(0, "spinning"),
        Mission(PlanRunner(Spinning(model), model), **mission),  # type: ignore[arg-type]  # by name
        lambda: next(_session_ids),
    )


class HostEnd:
    """A host with the interface that :class:`Ends` drives."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.session = host.session

    def open(self, now_ns: HostNs) -> None:
        self.host.open(now_ns)

    def turn(self, data: Sequence[bytes], now_ns: HostNs) -> bytes:
        for piece in data:
            self.host.receive(piece, now_ns)
        self.host.poll(now_ns)
        return self.host.data_to_send(now_ns)

    def deadline_ns(self) -> int:
        return self.host.next_deadline()


class SessionEnd:
    """A bare session; ``each_turn`` acts as the program that uses it."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.events: list[SessionEvent] = []
        self.each_turn: Callable[[HostNs], None] = lambda _now_ns: None

    def open(self, now_ns: HostNs) -> None:
        self.session.open(now_ns)

    def turn(self, data: Sequence[bytes], now_ns: HostNs) -> bytes:
        for piece in data:
            self.events += self.session.receive(piece, now_ns)
        self.events += self.session.poll(now_ns)
        self.each_turn(now_ns)
        return self.session.data_to_send()

    def deadline_ns(self) -> int:
        deadline = self.session.next_deadline()
        return deadline if deadline is not None else 1 << 62

    def of(self, kind: type[E]) -> list[E]:
        return [e for e in self.events if isinstance(e, kind)]


def session_end(
    catalogue: Catalogue = CATALOGUE, link: type[LinkBase] = Link, node: int | None = None
) -> SessionEnd:
    session = Session(lambda: next(_session_ids), catalogue=catalogue, link=link, node=node)
    return SessionEnd(session)


def sweeper(
    *,
    seed: int = 1,
    catalogue: Catalogue = CATALOGUE,
    node: int = 1,
    link: type[LinkBase] = Link,
) -> VirtualSweeper:
    """Return a device in the middle of an empty floor, with perfect sensors."""
    return VirtualSweeper(
        OPEN_FLOOR, seed=seed, noise="none", catalogue=catalogue, node=node, link=link
    )


class Ends:
    """Runs both ends and observes what the host sent, and whether the robot moves."""

    def __init__(  # noqa: PLR0913 - two ends, two directions, two clocks
        self,
        host: HostEnd | SessionEnd,
        device: VirtualSweeper,
        *,
        to_device: Wire | None = None,
        to_host: Wire | None = None,
        host_first_us: int = HOST_BOOT_US,
        device_first_us: int = 0,
    ) -> None:
        self.host = host
        self.device = device
        self.now_us = 0
        self.to_device = Valve(to_device or Pipe(1_000))
        self.to_host = Valve(to_host or Pipe(1_000))
        self.host_alive = True
        self.sent: list[Sent] = []
        self.moving_us = -1
        """Time at which the robot last moved, µs."""
        self.latched_us: int | None = None
        """Time since which the device holds a stop, µs."""
        self.watch: Callable[[], None] = lambda: None
        """Called after every step."""
        self.host_first_us = host_first_us
        self.booted_us = -device_first_us
        self._tap: LinkBase = type(host.session.link)(Direction.DEVICE)
        self._device_tap: LinkBase = type(host.session.link)(Direction.HOST)
        self._device_bytes: list[bytes] = []
        self._parameters: dict[str, float] = {}
        if device_first_us:
            device.step(b"", 0)
            device.skip_to(device_first_us)
        host.open(self.host_ns)

    @property
    def host_ns(self) -> HostNs:
        return HostNs((self.now_us + self.host_first_us) * 1000)

    @property
    def device_us(self) -> int:
        return self.now_us - self.booted_us

    @property
    def moving(self) -> bool:
        truth = self.device.plant.truth
        return abs(truth.v_m_s) > REST_M_S or abs(truth.yaw_rate_rad_s) > REST_RAD_S

    def restart_host(self, host: HostEnd | SessionEnd) -> None:
        """Replace the host as if it was killed; its bytes on the wire still arrive."""
        self.host = host
        self.host_alive = True
        host.open(self.host_ns)

    def reboot_device(self, boot_id: int) -> None:
        self.device.reset(ResetCause.SOFTWARE, boot_id=boot_id)

    def run(self, duration_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let both ends run.

        Return True once ``until`` is true, False if the time has run out before.
        """
        end_us = self.now_us + round(duration_s * 1e6)
        while self.now_us < end_us:
            self._step(end_us)
            if until():
                return True
        return False

    def _step(self, end_us: int) -> None:
        moments = [
            self.now_us + MAX_STEP_US,
            self.device.next_deadline_us() + self.booted_us,
            self.to_device.next_us(),
            self.to_host.next_us(),
        ]
        if self.host_alive:
            moments.append(-(-self.host.deadline_ns() // 1000) - self.host_first_us)
        soonest = min(m for m in moments if m is not None)
        self.now_us = min(end_us, max(self.now_us + 100, soonest))
        arrived = b"".join(self.to_device.pull(self.now_us))
        from_device = self.device.step(arrived, self.device_us)
        self._device_bytes.append(from_device)
        self.to_host.push(from_device, self.now_us)
        data = self.to_host.pull(self.now_us)
        if self.host_alive:
            out = self.host.turn(data, self.host_ns)
            self.note_sent(out)
            self.to_device.push(out, self.now_us)
        self._look()
        self.watch()

    def note_sent(self, out: bytes) -> None:
        for event in self._tap.receive(out, self.host_ns // 1000):
            if isinstance(event, Rejected) and event.frame.type_id == CAN_AUTH_TYPE:
                continue
            # signed frames are not checked here
            if isinstance(event, Rejected) and event.reason == "key":
                codec, frame = self._tap.codec, event.frame
                message = codec.decode(codec.catalogue.by_type[frame.type_id], frame.payload)
                self.sent.append(Sent(self.now_us, message))
                continue
            assert isinstance(event, Received), "the host wrote something unreadable"
            self.sent.append(Sent(self.now_us, event.message))

    def _look(self) -> None:
        if self.moving:
            self.moving_us = self.now_us
        if not self.device.firmware.latch.latched:
            self.latched_us = None
        elif self.latched_us is None:
            self.latched_us = self.now_us

    def parameter(self, name: str) -> float:
        """Return a parameter's newest value that the device has sent, even if it was lost."""
        for event in self._device_tap.receive(b"".join(self._device_bytes), 0):
            if isinstance(event, Received) and isinstance(event.message, ParameterValue):
                sent = event.message
                self._parameters[sent.name.partition(" ")[0]] = Parameter.from_message(sent).value
        self._device_bytes.clear()
        return self._parameters[name]

    def stop_by_another(self) -> None:
        """Stop the device as a sender without a session does."""
        link = type(self.host.session.link)(Direction.HOST)
        link.send(StopAll(), 0, node=0)
        self.device.step(link.data_to_send(), self.device_us)

    def setpoints_us(self) -> int:
        """Return when the host last wrote a setpoint with motion; -1: never."""
        for sent in reversed(self.sent):
            message = sent.message
            if isinstance(message, VelocitySetpoint) and (message.v or message.yaw_rate):
                return sent.at_us
        return -1


def check_safe(ends: Ends) -> None:
    """Check that the robot moves only with a fresh setpoint and an open latch, ramps aside."""
    if not ends.moving:
        return
    latched_us = ends.latched_us
    assert latched_us is None or ends.now_us - latched_us <= RAMP_US, "it moves while latched"
    asked_us = ends.setpoints_us()
    assert asked_us >= 0, "it moves and was never asked to"
    age_us = ends.now_us - asked_us
    assert age_us <= TIME_TO_LIVE_US + RAMP_US, f"it moves on a setpoint {age_us} us old"
