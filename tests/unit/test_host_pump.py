"""The loop that owns the port, with a port and a clock made by the test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.errors import PortBusyError, PortError
from bridge.io import clock, pump
from bridge.io.pump import Pump
from bridge.mission import Ending
from bridge.telemetry import EventRecord
from protocol.clock import HostNs
from protocol.link import Link, Received
from protocol.message import Direction
from protocol.messages import Stop, VelocitySetpoint
from protocol.values import StopCause
from support.ends import Collector, spinning_host, sweeper

if TYPE_CHECKING:
    from bridge.host import Host
    from sim_device.device import VirtualSweeper

CTRL_C = Ending("stopped", "ended by Ctrl-C", 0)


class FakeClock:
    def __init__(self) -> None:
        self.ns = 3_000_000_000

    def now(self) -> HostNs:
        return HostNs(self.ns)

    def pause(self, duration_s: float) -> None:
        self.ns += round(duration_s * 1e9)


class FakePort:
    """A device's port in the pump's own time; can stop taking bytes, or vanish."""

    name = "fake"

    def __init__(self, ticking: FakeClock, device: VirtualSweeper) -> None:
        self.clock = ticking
        self.device = device
        self.gone = False
        self.full = False
        self.silent = False
        self.closed = 0
        self.taken: list[tuple[int, bytes]] = []
        self._to_device = b""

    def wait(self, timeout_s: float) -> bytes:
        if self.gone:
            raise PortError("fake is gone: it was unplugged")
        self.clock.ns += max(1_000_000, min(round(timeout_s * 1e9), 10_000_000))
        data, self._to_device = self._to_device, b""
        out = self.device.step(data, self.clock.ns // 1000)
        return b"" if self.silent else out

    def write(self, data: bytes) -> int:
        if self.gone:
            raise PortError("fake is gone: it was unplugged")
        if self.full:
            return 0
        self.taken.append((self.clock.ns, data))
        self._to_device += data
        return len(data)

    def wake(self) -> None:
        pass

    def close(self) -> None:
        self.closed += 1


class Scene:
    """A pump on a fake port; ``at`` plans what happens when."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.clock = FakeClock()
        monkeypatch.setattr(clock, "now", self.clock.now)
        monkeypatch.setattr(clock, "pause", self.clock.pause)
        self.sink = Collector()
        self.host: Host = spinning_host(self.sink)
        self.port = FakePort(self.clock, sweeper())
        self.reopened: list[FakePort | PortError] = []
        self.pump = Pump(self.host, self.port, self._reopen)
        self.pump.watch = self._watch
        self._plans: list[tuple[float, object]] = []
        self._start_ns = self.clock.ns

    def at(self, time_s: float, action: object) -> None:
        self._plans.append((time_s, action))

    @property
    def time_s(self) -> float:
        return (self.clock.ns - self._start_ns) / 1e9

    def _watch(self) -> Ending | None:
        for plan in list(self._plans):
            if self.time_s >= plan[0]:
                self._plans.remove(plan)
                assert callable(plan[1])
                plan[1]()
        assert self.time_s < 100, "the run hangs"
        return None

    def _reopen(self) -> FakePort:
        if not self.reopened:
            raise PortBusyError("fake", 7)
        port = self.reopened[0]
        if isinstance(port, PortError):
            raise port
        return port

    def kinds(self) -> list[str]:
        return [e.kind for e in self.sink.of(EventRecord)]


@pytest.fixture(name="scene")
def _scene(monkeypatch: pytest.MonkeyPatch) -> Scene:
    return Scene(monkeypatch)


def messages(port: FakePort) -> list[tuple[int, object]]:
    link = Link(Direction.DEVICE)
    return [
        (at, e.message)
        for at, data in port.taken
        for e in link.receive(data)
        if isinstance(e, Received)
    ]


def test_ctrl_c_ends_with_a_stop_and_a_closed_port(scene: Scene) -> None:
    scene.at(4.0, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    assert scene.host.mission.ending == CTRL_C
    assert any(isinstance(m, Stop) for _, m in messages(scene.port)[-3:])
    assert scene.port.device.firmware.latch.cause is StopCause.SESSION_END
    assert scene.port.closed == 1
    assert scene.time_s < 4.2


def test_a_signal_between_two_lines_is_not_lost(scene: Scene) -> None:
    """It comes while ``watch`` is asked, after the pump has looked for it."""
    scene.at(4.0, lambda: scene.pump.request_end(CTRL_C))
    scene.at(60.0, lambda: pytest.fail("Ctrl-C was lost"))
    scene.pump.run()
    assert scene.host.mission.ending == CTRL_C


def test_a_duration_does_not_hide_that_nobody_answers(scene: Scene) -> None:
    scene.port.silent = True
    scene.pump.end_after(1.0)
    scene.pump.run()
    ending = scene.host.mission.ending
    assert ending is not None
    assert ending.exit_status == 3
    assert "nothing was heard" in ending.reason


def test_a_duration_ends_the_run(scene: Scene) -> None:
    scene.pump.end_after(5.0)
    scene.pump.run()
    ending = scene.host.mission.ending
    assert ending is not None
    assert (ending.outcome, ending.exit_status) == ("stopped", 0)
    assert 5.0 <= scene.time_s < 5.2


def test_a_port_that_vanishes_is_looked_for_and_given_up(scene: Scene) -> None:
    scene.at(4.0, lambda: setattr(scene.port, "gone", True))
    scene.pump.run()
    ending = scene.host.mission.ending
    assert ending is not None
    assert (ending.outcome, ending.exit_status) == ("fault", 3)
    assert 34.0 < scene.time_s < 37.0
    assert scene.kinds().count("port_lost") == 1
    assert scene.port.closed == 1


def test_a_port_that_comes_back_does_not_drive_on(scene: Scene) -> None:
    device = scene.port.device
    scene.at(4.0, lambda: setattr(scene.port, "gone", True))
    again = FakePort(scene.clock, device)
    scene.at(6.0, lambda: scene.reopened.append(again))
    scene.pump.run()
    ending = scene.host.mission.ending
    assert ending is not None
    assert ending.exit_status == 5
    assert scene.kinds().count("port_back") == 1
    assert device.firmware.latch.latched
    assert not [m for _, m in messages(again) if isinstance(m, VelocitySetpoint)]
    assert again.closed == 1


def test_ctrl_c_while_the_port_is_gone(scene: Scene) -> None:
    scene.at(4.0, lambda: setattr(scene.port, "gone", True))
    scene.at(5.0, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    assert scene.host.mission.ending == CTRL_C
    assert scene.time_s < 5.3


def test_a_full_port_gets_nothing_old(scene: Scene) -> None:
    """0.8 s without taking a byte: shorter than anybody's patience, longer than 50 ms."""
    scene.at(4.0, lambda: setattr(scene.port, "full", True))
    scene.at(4.8, lambda: setattr(scene.port, "full", False))
    scene.at(6.0, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    assert scene.kinds().count("stuck") == 1, "told once, not for every batch"
    gap = [at for at, _ in scene.port.taken if at > scene._start_ns + 4_700_000_000]  # noqa: SLF001
    link = Link(Direction.DEVICE)
    for at, data in scene.port.taken:
        for event in link.receive(data):
            if isinstance(event, Received) and isinstance(event.message, VelocitySetpoint):
                age_ns = at - event.frame.t_us * 1000
                assert age_ns <= pump.STUCK_NS, "the host sends nothing older than 50 ms"
    assert gap
    assert scene.host.mission.ending == CTRL_C


def test_a_crash_of_the_host_closes_the_port(scene: Scene) -> None:
    def crash() -> None:
        raise ZeroDivisionError

    scene.at(4.0, crash)
    with pytest.raises(ZeroDivisionError):
        scene.pump.run()
    assert scene.port.closed == 1
