"""The example device in C, compiled unchanged, connected to the host's session."""

from __future__ import annotations

import itertools
import random
import struct
import subprocess
from typing import TYPE_CHECKING, TypeVar

import pytest

from bridge.session.session import Session
from bridge.session.states import CommandEnded, Data, SessionReady, State
from protocol.clock import HostNs
from protocol.messages.device import Encoders, Hello, Imu, Status
from protocol.messages.host import (
    ClearStop,
    SaveParameters,
    SetMode,
    Stop,
    StopAll,
    VelocitySetpoint,
)
from protocol.messages.values import Fault, Mode, NackReason, StopCause
from protocol.uart.framing import Frame, UartParser
from support.c_build import C_TESTS, generate
from support.hostile import BitFlips, Chunked, CutTail, Lossy, Pipe, Wire
from support.root import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from bridge.session.states import SessionEvent
    from protocol.schema.message import Message

pytestmark = pytest.mark.slow

E = TypeVar("E")
STEP_US = 1_000
HOST_AHEAD_US = 5_000_000
_HEAD, _DRIVE, _TAKE = struct.Struct("=H"), struct.Struct("=ff"), struct.Struct("=IH")


class Device:
    """The example program in a separate process; the test sets its time."""

    def __init__(self, program: Path) -> None:
        self._process = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        self.drive = (0.0, 0.0)
        """Forward speed (m/s) and yaw rate (rad/s) that the wheels receive."""
        assert self._receive() == b""

    def turn(self, now_us: int, data: bytes) -> bytes:
        """Pass the time and received bytes; return the bytes that the device has written."""
        stdin = self._process.stdin
        assert stdin is not None
        stdin.write(_TAKE.pack(now_us & 0xFFFF_FFFF, len(data)) + data)
        stdin.flush()
        return self._receive()

    def _receive(self) -> bytes:
        (length,) = _HEAD.unpack(self._read(_HEAD.size))
        data = self._read(length)
        v, yaw_rate = _DRIVE.unpack(self._read(_DRIVE.size))
        self.drive = (v, yaw_rate)
        return data

    def _read(self, size: int) -> bytes:
        stdout, stderr = self._process.stdout, self._process.stderr
        assert stdout is not None
        assert stderr is not None
        data = stdout.read(size)
        assert len(data) == size, stderr.read().decode()
        return data

    def close(self) -> int:
        """End its input; return its exit status."""
        self._process.communicate(timeout=20)
        return self._process.returncode


class LoneDevice:
    """A session and the device on two wires, in virtual time."""

    def __init__(
        self,
        device: Device,
        to_device: Wire | None = None,
        to_host: Wire | None = None,
        first_session_id: int = 1,
    ) -> None:
        ids = itertools.count(first_session_id)
        self.device = device
        self.session = Session(lambda: next(ids))
        self.events: list[SessionEvent] = []
        self.now_us = 0
        self.host_alive = True
        self.each_step: Callable[[HostNs], None] = lambda _now_ns: None
        self._to_device = to_device or Pipe(STEP_US)
        self._to_host = to_host or Pipe(STEP_US)

    def run(self, for_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        """Let time pass; return True as soon as ``until`` is true."""
        end_us = self.now_us + round(for_s * 1e6)
        while self.now_us < end_us:
            self.now_us += STEP_US
            now_ns = HostNs((self.now_us + HOST_AHEAD_US) * 1000)
            if self.host_alive:
                for piece in self._to_host.pull(self.now_us):
                    self.events += self.session.receive(piece, now_ns)
                self.events += self.session.poll(now_ns)
                self.each_step(now_ns)
                self._to_device.push(self.session.data_to_send(), self.now_us)
            arrived = b"".join(self._to_device.pull(self.now_us))
            self._to_host.push(self.device.turn(self.now_us, arrived), self.now_us)
            if until():
                return True
        return False

    @property
    def now_ns(self) -> HostNs:
        return HostNs((self.now_us + HOST_AHEAD_US) * 1000)

    def open(self) -> None:
        self.session.open(self.now_ns)
        assert self.run(4.0, lambda: self.session.state is State.READY)

    def of(self, kind: type[E]) -> list[E]:
        return [e for e in self.events if isinstance(e, kind)]

    def received(self, kind: type[E]) -> list[E]:
        return [d.received.message for d in self.of(Data) if isinstance(d.received.message, kind)]

    def status(self) -> Status:
        """Return the next status."""
        count = len(self.received(Status))
        assert self.run(0.5, lambda: len(self.received(Status)) > count)
        return self.received(Status)[-1]

    def outcome(self) -> tuple[bool, int | None]:
        """Return the result of the running command."""
        count = len(self.of(CommandEnded))
        assert self.run(2.0, lambda: len(self.of(CommandEnded)) > count)
        outcome = self.of(CommandEnded)[-1].outcome
        return outcome.accepted, outcome.reason

    def start(self) -> None:
        """Go from an open session to driving."""
        self.session.clear_stop(StopCause.SESSION_END, self.now_ns)
        assert self.outcome() == (True, None)
        self.session.set_mode(Mode.VELOCITY, self.now_ns)
        assert self.outcome() == (True, None)

    def drive(self, v_m_s: float) -> None:
        """Send setpoints at 50 Hz from now on."""

        def each_step(now_ns: HostNs) -> None:
            if self.now_us % 20_000 == 0:
                self.session.setpoint(v_m_s, 0.1, 200, now_ns)

        self.each_step = each_step

    def stop_sending(self) -> None:
        """Send no more setpoints."""
        self.each_step = lambda _now_ns: None


def build(directory: Path, *flags: str) -> Path:
    generated = generate(directory)
    sources = [
        generated.source,
        ROOT / "examples" / "device_main.c",
        C_TESTS / "board_lockstep.c",
    ]
    all_flags = ("-O1", "-g", f"-I{ROOT / 'examples'}", *flags)
    return generated.compile("device", sources, flags=all_flags, sanitized=True)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("c_device"))


@pytest.fixture
def launch() -> Iterator[Callable[[Path], Device]]:
    """Yield a function that starts a program; it must exit cleanly when its input ends."""
    devices: list[Device] = []

    def start(program: Path) -> Device:
        devices.append(Device(program))
        return devices[-1]

    yield start
    assert [d.close() for d in devices] == [0] * len(devices)


@pytest.fixture
def device(program: Path, launch: Callable[[Path], Device]) -> Device:
    return launch(program)


def test_it_sends_hello_once_a_second_until_the_handshake(device: Device) -> None:
    bench = LoneDevice(device)
    parser = UartParser()
    wire = b"".join(device.turn(t * STEP_US, b"") for t in range(3_500))
    frames = parser.feed(wire)
    assert parser.damaged == 0
    assert [f.type_id for f in frames if isinstance(f, Frame)] == [0x1B] * 4
    bench.now_us = 3_500_000
    bench.open()
    assert bench.of(SessionReady)[-1].differences == ()
    assert bench.session.hello == Hello(
        bench.session.link.codec.catalogue.hash,
        b"lockstep-uid",
        0x12345678,
        bench.session.session_id,
        0,
        3,
        1,
        0,
        0,
        "example device",
    )


def test_it_streams_the_boards_readings(device: Device) -> None:
    bench = LoneDevice(device)
    bench.open()
    before = len(bench.received(Imu)), len(bench.received(Encoders))
    bench.run(2.0)
    assert len(bench.received(Imu)) - before[0] == 200
    assert len(bench.received(Encoders)) - before[1] == 100
    assert bench.received(Imu)[-1] == Imu(0, 0, 16384, 0, 0, 0, 0)
    assert bench.received(Encoders)[-1] == Encoders(100, 65436)
    assert bench.session.link.statistics.lost == 0
    assert bench.session.link.statistics.damaged == 0


def test_it_drives_only_when_asked_and_as_long_as_setpoints_are_fresh(device: Device) -> None:
    bench = LoneDevice(device)
    bench.open()
    bench.drive(0.2)
    bench.run(0.5)
    assert device.drive == (0.0, 0.0)  # latched from the start
    bench.start()
    assert bench.run(0.1, lambda: device.drive == pytest.approx((0.2, 0.1)))
    bench.stop_sending()
    assert bench.run(0.25, lambda: device.drive == (0.0, 0.0))
    status = bench.status()
    assert status.faults == Fault.SETPOINT_EXPIRED
    assert (status.mode, status.stop_cause) == (Mode.VELOCITY, StopCause.NONE)
    bench.drive(0.1)  # no latch: it continues
    assert bench.run(0.1, lambda: device.drive == pytest.approx((0.1, 0.1)))
    assert bench.status().faults == 0


def test_a_delayed_setpoint_is_rejected(device: Device) -> None:
    bench = LoneDevice(device)
    bench.open()
    bench.start()
    link = bench.session.link

    def moves(counter: int, age_us: int) -> bool:
        stamp_us = bench.now_us + HOST_AHEAD_US - age_us
        link.send(VelocitySetpoint(1000, 0, 200, counter), stamp_us, node=1)
        return bench.run(0.05, lambda: device.drive != (0.0, 0.0))

    assert not moves(1, 210_000)
    assert moves(2, 100_000)
    assert bench.run(0.12, lambda: device.drive == (0.0, 0.0))  # the rest of 200 ms
    assert not moves(2, 0)  # as old by its counter
    assert moves(3, 0)


def test_messages_to_all_neither_drive_nor_release_it(device: Device) -> None:
    bench = LoneDevice(device)
    bench.open()
    link = bench.session.link

    def send_to_all(*messages: Message) -> None:
        for message in messages:
            link.send(message, bench.now_us + HOST_AHEAD_US, node=0)
        bench.run(0.05)

    send_to_all(ClearStop(900, StopCause.SESSION_END))
    assert bench.status().stop_cause == StopCause.SESSION_END
    bench.start()
    send_to_all(VelocitySetpoint(1000, 0, 200, 1), SetMode(901, Mode.IDLE))
    assert device.drive == (0.0, 0.0)
    assert bench.status().mode == Mode.VELOCITY
    send_to_all(Stop(902, StopCause.SUPERVISE))
    assert bench.status().stop_cause == StopCause.NONE, "it names one device"
    send_to_all(StopAll())
    assert bench.status().stop_cause == StopCause.OPERATOR


def test_a_new_host_starts_from_nothing(device: Device) -> None:
    first = LoneDevice(device)
    first.open()
    first.start()
    first.drive(0.2)
    assert first.run(1.0) is False
    assert device.drive[0] > 0
    second = LoneDevice(device, first_session_id=100)
    second.now_us = first.now_us
    second.session.open(second.now_ns)
    assert second.run(0.3, lambda: device.drive == (0.0, 0.0))
    assert second.run(4.0, lambda: second.session.state is State.READY)
    assert second.status().stop_cause == StopCause.LINK
    second.session.clear_stop(StopCause.LINK, second.now_ns)
    assert second.outcome() == (True, None)
    second.session.set_mode(Mode.VELOCITY, second.now_ns)
    assert second.outcome() == (True, None)
    second.drive(0.1)  # its counter restarts
    assert second.run(0.1, lambda: device.drive[0] == pytest.approx(0.1))


def test_a_stop_is_latched_until_it_is_cleared_by_name(device: Device) -> None:
    bench = LoneDevice(device)
    bench.open()
    bench.start()
    bench.drive(0.2)
    bench.run(0.2)
    bench.session.stop(StopCause.OPERATOR, bench.now_ns)
    assert bench.outcome() == (True, None)
    assert device.drive == (0.0, 0.0)
    bench.run(0.5)
    assert device.drive == (0.0, 0.0)
    assert bench.status().stop_cause == StopCause.OPERATOR
    bench.session.set_mode(Mode.VELOCITY, bench.now_ns)
    assert bench.outcome() == (False, NackReason.STOP_LATCHED)
    bench.session.clear_stop(StopCause.LINK, bench.now_ns)
    assert bench.outcome() == (False, NackReason.OTHER_CAUSE)
    bench.session.clear_stop(StopCause.OPERATOR, bench.now_ns)
    assert bench.outcome() == (True, None)
    bench.session.set_mode(Mode.VELOCITY, bench.now_ns)
    assert bench.outcome() == (True, None)
    assert bench.run(0.1, lambda: device.drive[0] > 0)


def test_a_silent_host_is_a_latched_stop_and_a_new_hello(device: Device) -> None:
    bench = LoneDevice(device)
    bench.open()
    bench.start()
    bench.drive(0.2)
    bench.run(0.2)
    assert device.drive[0] > 0
    bench.host_alive = False
    bench.run(1.3)
    assert device.drive == (0.0, 0.0)
    bench.host_alive = True
    bench.stop_sending()
    assert bench.run(5.0, lambda: bench.session.state is not State.READY)
    assert bench.run(5.0, lambda: bench.session.state is State.READY)
    assert bench.status().stop_cause == StopCause.LINK
    assert device.drive == (0.0, 0.0)


def test_a_repeated_command_is_answered_and_not_carried_out_again(device: Device) -> None:
    bench = LoneDevice(device)
    bench.open()
    bench.start()
    session = bench.session
    clear = ClearStop(700, StopCause.OPERATOR)
    for again in range(2):
        session.link.send(clear, bench.now_us + HOST_AHEAD_US, node=1)
        bench.run(0.1)
        # A second execution would clear what was latched meanwhile.
        assert bench.status().stop_cause == (StopCause.OPERATOR if again else StopCause.NONE)
        session.stop(StopCause.OPERATOR, bench.now_ns)
        bench.run(0.1)


def test_unsupported_commands_are_rejected(device: Device) -> None:
    bench = LoneDevice(device)
    bench.open()
    session = bench.session
    session.commands.issue(SaveParameters, 0x72, bench.now_us + HOST_AHEAD_US)
    assert bench.outcome() == (False, NackReason.UNSUPPORTED)


def test_it_negotiates_and_obeys_on_a_bad_link(device: Device) -> None:
    rng = random.Random(9)

    def bad() -> Wire:
        wire: Wire = Pipe(STEP_US)
        for kind, p in ((Lossy, 0.03), (CutTail, 0.03), (BitFlips, 0.05)):
            wire = kind(wire, p, rng)
        return Chunked(wire, 7)

    bench = LoneDevice(device, bad(), bad())
    bench.open()
    bench.start()
    bench.drive(0.2)
    assert bench.run(1.0, lambda: device.drive[0] > 0)
    bench.run(5.0)
    assert bench.session.state is State.READY
    bench.session.stop(StopCause.OPERATOR, bench.now_ns)
    assert bench.run(1.0, lambda: device.drive == (0.0, 0.0))
    assert bench.session.link.statistics.damaged > 10


def test_a_minimal_build_negotiates_message_by_message(
    tmp_path: Path, launch: Callable[[Path], Device]
) -> None:
    device = launch(build(tmp_path, "-DSP_MINIMAL", "-DSP_WITH_POWER=0"))
    bench = LoneDevice(device)
    bench.open()
    missing = {d.spec.name for d in bench.of(SessionReady)[-1].differences}
    assert {"range", "power", "sync", "planner_state", "parameter_value"} <= missing
    assert not missing & {"imu", "encoders", "status", "velocity_setpoint", "set_mode"}
    bench.start()
    bench.drive(0.2)
    assert bench.run(0.2, lambda: device.drive[0] > 0)
