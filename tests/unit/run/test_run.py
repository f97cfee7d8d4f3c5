"""Runs of the host with the virtual sweeper: start, interruptions and end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bridge.run.ending import Ending
from bridge.run.mission import Phase
from bridge.session.records import EventRecord, Record, Severity
from bridge.session.states import State
from protocol.clock import HostNs
from protocol.messages.device import Hello
from protocol.messages.host import Stop, VelocitySetpoint
from protocol.messages.values import Mode, StopCause
from protocol.schema.codec import Codec
from protocol.schema.message import specify
from protocol.uart.framing import encode_frame
from support.ends import (
    RAMP_US,
    TIME_TO_LIVE_US,
    Collector,
    Ends,
    HostEnd,
    check_safe,
    spinning_host,
    sweeper,
)

if TYPE_CHECKING:
    from bridge.run.host import Host

pytestmark = pytest.mark.usefixtures("target")

CTRL_C = Ending("stopped", "ended by Ctrl-C", 0)


def started() -> tuple[Ends, Host]:
    host = spinning_host()
    ends = Ends(HostEnd(host), sweeper())
    ends.watch = lambda: check_safe(ends)
    assert ends.run(6.0, lambda: ends.moving), host.mission.phase
    return ends, host


def events(host: Host) -> list[tuple[str, str]]:
    sink = host.sink
    assert isinstance(sink, Collector)
    return [(e.source, e.kind) for e in sink.of(EventRecord)]


def ending(host: Host) -> Ending:
    assert host.mission.ending is not None
    return host.mission.ending


def test_a_plan_moves_only_after_settling() -> None:
    ends, host = started()
    assert host.mission.phase is Phase.DRIVING
    assert ends.now_us > 2_500_000
    assert ends.device.firmware.mode is Mode.VELOCITY


def test_ctrl_c_stops_the_robot_and_waits_for_its_word() -> None:
    ends, host = started()
    ends.run(1.0)
    at_us = ends.now_us
    host.end(CTRL_C, ends.host_ns)
    assert ends.run(2.0, lambda: host.mission.done)
    assert ends.now_us - at_us < 50_000
    assert ends.device.firmware.latch.cause is StopCause.SESSION_END
    assert ending(host) == CTRL_C
    ends.run(1.0)
    assert ends.moving_us <= at_us + RAMP_US
    assert not [s for s in ends.sent if isinstance(s.message, VelocitySetpoint) and s.at_us > at_us]


def test_the_stop_goes_out_before_any_listener_runs() -> None:
    class TransmitOnly(Collector):
        """A sink that fails at the event of a stop, as a closed terminal does."""

        def write(self, record: Record) -> None:
            if isinstance(record, EventRecord) and record.kind == "stop":
                raise BrokenPipeError
            super().write(record)

    host = spinning_host(TransmitOnly())
    ends = Ends(HostEnd(host), sweeper())
    assert ends.run(6.0, lambda: ends.moving)
    with pytest.raises(BrokenPipeError):
        host.end(CTRL_C, ends.host_ns)
    ends.note_sent(out := host.data_to_send(ends.host_ns))
    assert out
    assert [s for s in ends.sent if isinstance(s.message, Stop)]


def test_ctrl_c_with_a_silent_device_still_sends_a_stop() -> None:
    ends, host = started()
    ends.to_host.cut = True
    assert ends.run(3.0, lambda: host.session.state is State.LOST)
    host.end(CTRL_C, ends.host_ns)
    assert host.mission.done
    ends.run(0.1)
    assert [s for s in ends.sent if isinstance(s.message, Stop)]
    assert ends.device.firmware.latch.latched


def test_ctrl_c_before_any_device_answered() -> None:
    host = spinning_host()
    ends = Ends(HostEnd(host), sweeper())
    ends.to_device.cut = ends.to_host.cut = True
    ends.run(0.5)
    host.end(CTRL_C, ends.host_ns)
    assert host.mission.done
    assert ending(host) == CTRL_C


@pytest.mark.parametrize("both", [True, False])
def test_a_lost_link_stops_the_robot_and_the_run_asks(both: bool) -> None:  # noqa: FBT001 - two cases
    ends, host = started()
    at_us = ends.now_us
    ends.to_device.cut = True
    ends.to_host.cut = both
    ends.run(4.0, lambda: host.mission.phase is Phase.HOLDING)
    assert host.mission.phase is Phase.HOLDING
    assert ends.moving_us <= at_us + TIME_TO_LIVE_US + RAMP_US
    assert ends.device.firmware.latch.cause is StopCause.LINK
    ends.to_device.cut = ends.to_host.cut = False
    assert ends.run(5.0, lambda: host.mission.done)
    assert ending(host).exit_status == 5
    ends.run(2.0)
    assert ends.moving_us <= at_us + TIME_TO_LIVE_US + RAMP_US, (
        "the robot does not continue by itself"
    )


def test_lost_for_good_ends_after_30_s() -> None:
    ends, host = started()
    ends.to_device.cut = ends.to_host.cut = True
    at_us = ends.now_us
    assert ends.run(40.0, lambda: host.mission.done)
    assert 30e6 < ends.now_us - at_us < 33e6
    assert (ending(host).outcome, ending(host).exit_status) == ("fault", 3)


def test_a_reboot_while_driving_ends_the_run() -> None:
    ends, host = started()
    ends.reboot_device(4711)
    assert ends.run(5.0, lambda: host.mission.done)
    assert ending(host).exit_status == 5
    assert ("session", "negotiating") in events(host)
    ends.run(2.0)
    assert not ends.moving


def test_a_reboot_during_monitoring_keeps_the_pose_and_continues() -> None:
    ends, host = started()
    ends.run(3.0)
    pose = host.estimator.pose
    supervisor = spinning_host()
    supervisor.mission.runner = None
    supervisor.estimator.reset(pose)
    ends.restart_host(HostEnd(supervisor))
    ends.run(3.0)
    before = supervisor.estimator.pose
    ends.reboot_device(4711)
    ends.run(6.0)
    assert supervisor.session.state is State.READY
    assert supervisor.estimator.pose.distance_m(before) < 0.01
    fit = supervisor.sync.fit
    assert fit is not None
    assert fit.device_us < 7_000_000, "the fit is of the new boot's clock"
    assert supervisor.sync.steps == 0


def test_a_stalled_wire_and_its_burst_move_nothing() -> None:
    ends, host = started()
    at_us = ends.now_us
    ends.to_device.held = True
    ends.run(3.0)
    assert not ends.moving
    ends.to_device.held = False  # the setpoints of 3 s arrive at once
    ends.run(3.0)
    assert ends.moving_us <= at_us + TIME_TO_LIVE_US + RAMP_US
    assert host.mission.phase is Phase.DONE


def test_a_frozen_host_does_not_jump() -> None:
    ends, host = started()
    at_us = ends.now_us
    ends.host_alive = False  # SIGSTOP, or a blocked loop
    ends.run(0.7)
    assert not ends.moving
    assert ends.moving_us <= at_us + TIME_TO_LIVE_US + RAMP_US
    sent = len(ends.sent)
    ends.host_alive = True
    ends.run(0.0005)
    assert ("session", "late") in events(host)
    assert not [s for s in ends.sent[sent:] if isinstance(s.message, VelocitySetpoint)]
    # A pause under 1 s latches no stop, so the run continues with fresh setpoints.
    ends.run(2.0)
    assert host.mission.phase is Phase.DRIVING


def test_a_host_frozen_for_long_finds_the_stop_latched() -> None:
    ends, host = started()
    ends.host_alive = False
    ends.run(3.0)
    assert ends.device.firmware.latch.cause is StopCause.LINK
    ends.host_alive = True
    assert ends.run(3.0, lambda: host.mission.done)
    assert ending(host).exit_status == 5
    ends.run(1.0)
    assert not ends.moving


def test_a_killed_host_and_its_successor() -> None:
    ends, _ = started()
    at_us = ends.now_us
    second = spinning_host()
    ends.restart_host(HostEnd(second))
    assert ends.run(3.0, lambda: second.mission.done)
    assert ending(second).exit_status == 5
    assert "cause: link" in ending(second).reason
    assert ends.moving_us <= at_us + TIME_TO_LIVE_US + RAMP_US
    third = spinning_host(clear_stop=True)
    ends.restart_host(HostEnd(third))
    assert ends.run(6.0, lambda: ends.moving)
    assert third.mission.phase is Phase.DRIVING


@pytest.mark.parametrize("host_first_us", [200_000, 3_600_000_000])
def test_a_successor_on_another_clock(host_first_us: int) -> None:
    """The age of the new host's frames is not judged by the old host's clock."""
    ends, _ = started()
    ends.host_first_us = host_first_us
    second = spinning_host(clear_stop=True)
    ends.restart_host(HostEnd(second))
    assert ends.run(6.0, lambda: second.mission.phase is Phase.DRIVING)
    assert ends.run(1.0, lambda: ends.moving)


def test_an_orderly_end_needs_no_clear_stop() -> None:
    ends, host = started()
    host.end(CTRL_C, ends.host_ns)
    ends.run(2.0)
    second = spinning_host()
    ends.restart_host(HostEnd(second))
    assert ends.run(6.0, lambda: ends.moving)


@pytest.mark.python_only("stops the device from inside")
def test_an_operators_stop_from_elsewhere_ends_the_run() -> None:
    ends, host = started()
    ends.device.firmware.stop(StopCause.OPERATOR)
    assert ends.run(1.0, lambda: host.mission.done)
    assert ending(host).exit_status == 5
    assert "operator" in ending(host).reason
    assert ends.device.firmware.latch.cause is StopCause.OPERATOR, (
        "the cause with the higher rank stays"
    )


@pytest.mark.python_only("silences a stream from inside")
def test_a_sensor_that_falls_silent_stops_the_robot() -> None:
    ends, host = started()
    ends.device.firmware.schedule.set_rate(0x20, 0)  # a sensor that hangs
    assert ends.run(2.0, lambda: host.mission.done)
    assert "range" in ending(host).reason
    assert ending(host).exit_status == 5
    assert ends.device.firmware.latch.cause is StopCause.SUPERVISE


def test_watching_moves_nothing() -> None:
    host = spinning_host()
    host.mission.runner = None
    ends = Ends(HostEnd(host), sweeper())
    ends.run(5.0)
    assert host.session.state is State.READY
    assert ends.moving_us < 0
    assert ends.device.firmware.latch.cause is StopCause.SESSION_END
    assert not [s for s in ends.sent if isinstance(s.message, VelocitySetpoint)]


def test_failures_are_logged() -> None:
    sink = Collector()
    host = spinning_host(sink)
    ends = Ends(HostEnd(host), sweeper())
    ends.to_host.cut = ends.to_device.cut = True
    assert ends.run(4.0, lambda: host.mission.done)
    (failure,) = [e for e in sink.of(EventRecord) if e.severity is Severity.ERROR]
    assert failure.kind == "silence"
    assert ending(host).exit_status == 3


@pytest.mark.python_only("sets the clock of the chip")
def test_it_runs_across_the_wrap_of_both_clocks() -> None:
    wrap = 1 << 32
    host = spinning_host()
    ends = Ends(
        HostEnd(host),
        sweeper(),
        host_first_us=wrap - 5_000_000,
        device_first_us=wrap - 4_000_000,
    )
    ends.watch = lambda: check_safe(ends)
    assert ends.run(6.0, lambda: ends.moving)
    ends.run(6.0)
    assert host.mission.phase is Phase.DRIVING
    assert host.session.link.statistics.lost == 0
    assert ends.now_us - ends.moving_us < 100_000
    mapped = host.sync.map(host.sync.extend(ends.device_us % wrap))
    assert mapped is not None
    assert abs(mapped.host_ns - HostNs(ends.host_ns)) <= mapped.bound_ns + 12_000_000


def test_another_device_that_answers_a_drive_stops_the_robot() -> None:
    """The session fails at once and sends a stop, before the device's watchdog expires."""
    ends, host = started()
    known = host.hello
    assert known is not None
    payload = bytearray(Codec().encode(known)[1])
    payload[4:16] = b"\x22" * 12
    host.receive(encode_frame(1, specify(Hello).type_id, 0, 0, bytes(payload)), ends.host_ns)
    assert host.session.state is State.FAILED
    assert (ending(host).outcome, ending(host).exit_status) == ("fault", 3)
    assert "did not confirm the stop" in ending(host).reason
    ends.run(0.1)
    assert ends.device.firmware.latch.latched
    assert ends.device.firmware.latch.cause is StopCause.LINK
    ends.run(1.0)
    assert not ends.moving
