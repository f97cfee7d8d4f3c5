"""The loop that owns the port, tested with a fake port and a fake clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.api import pump
from bridge.api.pump import Pump
from bridge.errors import DeviceLostError, PortBusyError, PortError
from bridge.io import clock
from bridge.run.ending import Ending
from bridge.session.records import EventRecord
from protocol.clock import HostNs
from protocol.errors import FieldRangeError
from protocol.link import Received
from protocol.messages.host import GetParameter, Stop, VelocitySetpoint
from protocol.messages.values import StopCause
from protocol.schema.message import Direction
from protocol.uart.link import Link
from support.ends import Collector, spinning_host, sweeper

if TYPE_CHECKING:
    from concurrent.futures import Future

    from bridge.run.host import Host
    from bridge.session.records import Record
    from sim_device.sweeper import VirtualSweeper

pytestmark = pytest.mark.slow

CTRL_C = Ending("stopped", "ended by Ctrl-C", 0)
OPERATOR = Ending("stopped", "stopped by another process", 5, StopCause.OPERATOR)


class FakeClock:
    def __init__(self) -> None:
        self.ns = 3_000_000_000

    def now(self) -> HostNs:
        return HostNs(self.ns)

    def pause(self, duration_s: float) -> None:
        self.ns += round(duration_s * 1e9)


class FakePort:
    """A device's port in the time of a fake clock. It can become full, or disappear."""

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


class Filling(Collector):
    """A sink that can become full."""

    full = False

    def write(self, record: Record) -> None:
        if self.full:
            raise OSError(28, "No space left on device")
        super().write(record)


class Scene:
    """A pump on a fake port; ``at`` schedules the test's actions."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.clock = FakeClock()
        monkeypatch.setattr(clock, "now", self.clock.now)
        monkeypatch.setattr(clock, "pause", self.clock.pause)
        self.sink = Filling()
        self.host: Host = spinning_host(self.sink)
        self.port = FakePort(self.clock, sweeper())
        self.reopened: list[FakePort | PortError] = []
        self.pump = Pump(self.host, self.port, self._reopen)
        self.pump.watch = self._watch
        self._plans: list[tuple[float, object]] = []
        self.start_ns = self.clock.ns

    def at(self, time_s: float, action: object) -> None:
        self._plans.append((time_s, action))

    @property
    def time_s(self) -> float:
        return (self.clock.ns - self.start_ns) / 1e9

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
    """It arrives during ``watch``, after the pump has checked for it."""
    scene.at(4.0, lambda: scene.pump.request_end(CTRL_C))
    scene.at(60.0, lambda: pytest.fail("Ctrl-C was lost"))
    scene.pump.run()
    assert scene.host.mission.ending == CTRL_C


def test_a_duration_does_not_hide_a_missing_device(scene: Scene) -> None:
    scene.port.silent = True
    scene.pump.end_after(1.0)
    scene.pump.run()
    ending = scene.host.mission.ending
    assert ending is not None
    assert ending.exit_status == 3
    assert "nothing received" in ending.reason


def test_a_duration_ends_the_run(scene: Scene) -> None:
    scene.pump.end_after(5.0)
    scene.pump.run()
    ending = scene.host.mission.ending
    assert ending is not None
    assert (ending.outcome, ending.exit_status) == ("stopped", 0)
    assert 5.0 <= scene.time_s < 5.2


def test_a_vanished_port_is_searched_and_then_lost(scene: Scene) -> None:
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
    ending = scene.host.mission.ending
    assert ending is not None
    assert ending.reason == "ended by Ctrl-C; the device did not confirm the stop"
    assert (ending.outcome, ending.exit_status) == ("fault", 3), "the robot was under way"
    assert scene.time_s < 5.3


def test_a_full_port_receives_no_old_bytes(scene: Scene) -> None:
    """The port takes no byte for 0.8 s: shorter than every timeout, longer than 50 ms."""
    scene.at(4.0, lambda: setattr(scene.port, "full", True))
    scene.at(4.8, lambda: setattr(scene.port, "full", False))
    scene.at(6.0, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    assert scene.kinds().count("stuck") == 1, "reported once, not for every batch"
    gap = [at for at, _ in scene.port.taken if at > scene.start_ns + 4_700_000_000]
    link = Link(Direction.DEVICE)
    for at, data in scene.port.taken:
        for event in link.receive(data):
            if isinstance(event, Received) and isinstance(event.message, VelocitySetpoint):
                age_ns = at - event.frame.t_us * 1000
                assert age_ns <= pump.STUCK_NS, "the host sends nothing older than 50 ms"
    assert gap
    assert scene.host.mission.ending == CTRL_C


def crash() -> None:
    raise ZeroDivisionError("what nobody has foreseen")


def stops(port: FakePort) -> list[StopCause]:
    return [StopCause(m.cause) for _, m in messages(port) if isinstance(m, Stop)]


def ended(scene: Scene) -> Ending:
    assert scene.host.mission.ending is not None
    return scene.host.mission.ending


def test_a_crash_in_the_loop_stops_the_robot_and_ends_as_a_fault(scene: Scene) -> None:
    scene.at(4.0, crash)
    scene.pump.run()
    assert (ended(scene).outcome, ended(scene).exit_status) == ("fault", 1)
    assert "ZeroDivisionError: what nobody has foreseen" in ended(scene).reason
    assert "the device has confirmed the stop" in ended(scene).reason
    assert "\n" not in ended(scene).reason
    assert scene.port.device.firmware.latch.cause is StopCause.SUPERVISE
    assert scene.pump.result == (ended(scene), StopCause.SUPERVISE)
    assert isinstance(scene.pump.crash, ZeroDivisionError)
    assert scene.port.closed == 1
    assert scene.time_s < 4.2
    (event,) = [e for e in scene.sink.of(EventRecord) if e.kind == "crash"]
    assert "Traceback" in str(event.data["traceback"])
    assert "Traceback" not in event.text


@pytest.mark.parametrize(
    "part",
    ["receive", "poll", "next_deadline", "end", "sent"],
    ids=["messages", "control step", "timers", "the end", "records"],
)
def test_a_crash_in_any_part_of_the_host_stops_the_robot(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    def broken(*_: object, **__: object) -> None:
        crash()

    scene.at(4.0, lambda: monkeypatch.setattr(scene.host, part, broken))
    scene.at(4.1, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    assert (ended(scene).outcome, ended(scene).exit_status) == ("fault", 1)
    assert scene.port.device.firmware.latch.cause is StopCause.SUPERVISE


def test_a_sink_that_fails_stops_the_robot(scene: Scene) -> None:
    scene.at(4.0, lambda: setattr(scene.sink, "full", True))
    scene.pump.run()
    assert (ended(scene).outcome, ended(scene).exit_status) == ("fault", 1)
    assert "No space left" in ended(scene).reason
    assert scene.port.device.firmware.latch.cause is StopCause.SUPERVISE


def test_the_interpreters_exit_stops_the_robot_and_then_exits(scene: Scene) -> None:
    def leave() -> None:
        raise SystemExit(7)

    scene.at(4.0, leave)
    with pytest.raises(SystemExit):
        scene.pump.run()
    assert scene.port.device.firmware.latch.cause is StopCause.SUPERVISE
    assert scene.port.closed == 1


def test_a_crash_on_a_dead_line_is_not_called_confirmed(scene: Scene) -> None:
    def cut() -> None:
        scene.port.silent = True
        crash()

    scene.at(4.0, cut)
    scene.pump.run()
    assert "the device did not confirm the stop" in ended(scene).reason
    assert scene.pump.result is not None
    assert scene.pump.result.confirmed is StopCause.NONE
    assert len(stops(scene.port)) > 10, "it was repeated"
    assert scene.time_s < 5.3, "and not for ever"


def test_a_crash_while_the_port_is_gone_tries_it_again(scene: Scene) -> None:
    again = FakePort(scene.clock, scene.port.device)

    def gone() -> None:
        scene.port.gone = True
        scene.reopened.append(again)
        crash()

    scene.at(4.0, gone)
    scene.pump.run()
    assert scene.port.device.firmware.latch.cause is StopCause.SUPERVISE
    assert "has confirmed" in ended(scene).reason
    assert (scene.port.closed, again.closed) == (1, 1)


def test_an_operators_stop_beside_a_crash_is_the_one_that_is_latched(scene: Scene) -> None:
    def both() -> None:
        scene.pump.request_end(OPERATOR)
        crash()

    scene.at(4.0, both)
    scene.pump.run()
    assert scene.port.device.firmware.latch.cause is StopCause.OPERATOR
    assert scene.pump.result is not None
    assert scene.pump.result.confirmed is StopCause.OPERATOR


# ---- actions of other threads ---------------------------------------------------------------


def test_an_exception_of_a_call_is_raised_in_the_caller(scene: Scene) -> None:
    answers: list[Future[None]] = []
    scene.at(4.0, lambda: answers.append(scene.pump.call(crash)))
    scene.at(5.0, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    with pytest.raises(ZeroDivisionError):
        answers[0].result(0)
    assert ended(scene) == CTRL_C, "the run goes on"
    assert scene.kinds().count("failed") == 1, "and it is not silent"


def test_an_abandoned_call_is_not_made(scene: Scene) -> None:
    made: list[int] = []
    scene.at(4.0, lambda: scene.pump.call(lambda: made.append(1)).cancel())
    scene.at(5.0, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    assert made == []


def test_a_call_after_the_end_is_answered(scene: Scene) -> None:
    scene.at(4.0, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    with pytest.raises(DeviceLostError, match="ended by Ctrl-C"):
        scene.pump.call(lambda: 1).result(0)


@pytest.mark.parametrize("number", [256, 300, -1, 10**3000])
def test_a_command_that_cannot_be_encoded_leaves_nothing_in_the_loop(
    scene: Scene, number: int
) -> None:
    """Any code in the loop may send it: a timer does not repeat it, because that would raise."""
    outcomes: list[object] = []

    def ask() -> None:
        scene.host.commands.ask(GetParameter, (number,), clock.now(), outcomes.append)

    def fetch() -> None:
        scene.host.commands.fetch(number, clock.now(), lambda *printed: outcomes.append(printed))

    answers: list[Future[None]] = []
    scene.at(4.0, lambda: answers.extend([scene.pump.call(ask), scene.pump.call(fetch)]))
    scene.at(6.0, lambda: scene.pump.request_end(CTRL_C))
    scene.pump.run()
    for answer in answers:
        with pytest.raises(FieldRangeError):
            answer.result(0)
    assert ended(scene) == CTRL_C
    assert outcomes == []


# ---- two causes at once --------------------------------------------------------------------


@pytest.mark.parametrize("first", [CTRL_C, OPERATOR], ids=["Ctrl-C first", "operator first"])
@pytest.mark.parametrize("apart_s", [0.0, 0.001, 0.01, 0.03, 0.1])
def test_the_graver_of_two_causes_is_latched(scene: Scene, first: Ending, apart_s: float) -> None:
    second = OPERATOR if first is CTRL_C else CTRL_C
    scene.at(4.0, lambda: scene.pump.request_end(first))
    scene.at(4.0 + apart_s, lambda: scene.pump.request_end(second))
    scene.pump.run()
    result = scene.pump.result
    assert result is not None
    late = scene.port.device.firmware.latch.cause is StopCause.SESSION_END
    if late:  # the run was over before the second arrived: it is not reported as executed
        assert (first, result.confirmed) == (CTRL_C, StopCause.SESSION_END)
        assert apart_s >= 0.01, "a stop within one turn of the loop is never late"
    else:
        assert result == (OPERATOR, StopCause.OPERATOR)
        assert scene.port.device.firmware.latch.cause is StopCause.OPERATOR


def test_a_graver_stop_after_an_unanswered_one_is_sent_and_awaited(scene: Scene) -> None:
    """The first stop is in progress and its answer is late, as over a slow line."""

    def hush() -> None:
        scene.port.silent = True
        scene.pump.request_end(CTRL_C)

    scene.at(4.0, hush)
    scene.at(4.5, lambda: scene.pump.request_end(OPERATOR))
    scene.at(4.7, lambda: setattr(scene.port, "silent", False))
    scene.pump.run()
    assert set(stops(scene.port)) == {StopCause.SESSION_END, StopCause.OPERATOR}
    assert scene.pump.result == (OPERATOR, StopCause.OPERATOR)
    assert scene.port.device.firmware.latch.cause is StopCause.OPERATOR


def test_the_end_of_a_run_in_motion_without_a_confirmation_is_a_fault(scene: Scene) -> None:
    def hush() -> None:
        scene.port.silent = True
        scene.pump.request_end(CTRL_C)

    scene.at(4.0, hush)
    scene.pump.run()
    assert (ended(scene).outcome, ended(scene).exit_status) == ("fault", 3)
    assert ended(scene).reason == "ended by Ctrl-C; the device did not confirm the stop"
