"""``bridge.open``: a robot as a Python object, on a virtual sweeper behind a real pty."""

from __future__ import annotations

import json
import random
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import bridge
from bridge.api.remote import RemoteRobot, reach
from bridge.api.robot import SETPOINT_TIMEOUT_S, Latest, ManualDrive, Robot
from bridge.errors import (
    BridgeError,
    CommandRejectedError,
    DeviceLostError,
    NoDeviceError,
    OutputExistsError,
    ParameterError,
    PortError,
    StoppedForSafetyError,
)
from bridge.io import clock
from bridge.motion.geometry import Pose2
from bridge.motion.observation import HALT, Observation, VelocityCommand
from bridge.record.errors import LogError
from bridge.record.reader import LogReader
from bridge.session.states import State
from protocol.messages.device import Encoders, Imu, Range, Status
from protocol.messages.values import Mode, StopCause
from sim_device.ports import PtyPort
from support.emulated import PLAN, Emulated
from support.observed import AT_REST
from support.waiting import PATIENCE_S, until

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("target")]


@pytest.fixture
def emulated() -> Iterator[Emulated]:
    with Emulated() as emulated:
        yield emulated


def another(stream: Latest[Encoders]) -> None:
    """Wait for the stream's next sample."""
    before = stream.latest
    until(lambda: stream.latest is not before)


def test_data_comes_by_itself_and_nothing_moves(emulated: Emulated) -> None:
    start = emulated.pose
    with bridge.open(emulated.port) as robot:
        streams = (robot.imu, robot.encoders, robot.range, robot.status, robot.power)
        until(lambda: all(stream.latest is not None for stream in streams))
        imu, ranges, status = robot.imu.latest, robot.range.latest, robot.status.latest
        assert isinstance(imu, Imu)
        assert imu.accel_z_m_s2 == pytest.approx(9.81, abs=0.5)
        assert isinstance(robot.encoders.latest, Encoders)
        assert isinstance(ranges, Range)
        assert ranges.ultrasonic_m == pytest.approx(3.0 - 0.12, abs=0.05)
        assert isinstance(status, Status)
        assert status.mode == Mode.IDLE
        until(lambda: robot.imu.latest is not imu)
        with pytest.raises(StoppedForSafetyError, match="enable"):
            robot.drive(0.2, 0.0)
        assert not robot.enabled
        assert robot.pose == Pose2(0.0, 0.0, 0.0)
        assert emulated.pose == start
        assert emulated.holds(StopCause.SESSION_END), "as it booted"

    with pytest.raises(StoppedForSafetyError, match="closed"):
        robot.enable(clear_stop=True)
    with bridge.open(emulated.port, node=1) as again:  # the port is free again
        until(lambda: again.status.latest is not None)


def test_it_drives_for_the_given_time(emulated: Emulated) -> None:
    start = emulated.pose
    with bridge.open(emulated.port) as robot:
        robot.enable()
        assert robot.enabled
        robot.enable()  # a second call is no error
        for wrong in (float("nan"), float("inf")):
            with pytest.raises(ValueError, match="finite number"):
                robot.drive(wrong, 0.0)
        until(lambda: emulated.pose.x_m - start.x_m > 0.1, lambda: robot.drive(99.0, 0.0))
        assert emulated.device.truth.v_m_s < robot.model.max_speed_m_s + 0.05
        until(lambda: emulated.device.truth.v_m_s == 0.0)
        assert emulated.holds(StopCause.NONE), "letting go is no stop"
        assert robot.enabled
        moved = emulated.pose.x_m - start.x_m
        assert moved < 1.0
        until(lambda: abs(robot.pose.x_m - moved) < 0.02)
    assert emulated.holds(StopCause.SESSION_END), "closed in order"


def test_a_stop_holds_until_a_person_frees_it(emulated: Emulated, tmp_path: Path) -> None:
    with bridge.open(emulated.port) as robot:
        robot.enable()
        until(lambda: emulated.pose.theta_rad > 0.2, lambda: robot.drive(0.0, 1.0))
        robot.stop()
        assert emulated.holds(StopCause.OPERATOR)
        with pytest.raises(StoppedForSafetyError, match="stopped by the program"):
            robot.drive(0.1, 0.0)
        with pytest.raises(StoppedForSafetyError, match="operator"):
            robot.enable()
        assert emulated.holds(StopCause.OPERATOR)
        until(lambda: emulated.device.truth.v_m_s == 0.0)
        stopped, believed = emulated.pose, robot.pose
        robot.enable(clear_stop=True)
        assert emulated.holds(StopCause.NONE)
        assert robot.pose.distance_m(believed) < 0.005, "the estimate goes on from there"
        until(lambda: emulated.pose.distance_m(stopped) > 0.05, lambda: robot.drive(0.2, 0.0))
        robot.stop()
        # A call on an ended session must not use its file descriptor: a new file may have this
        # number.
        files = [(tmp_path / f"{i}").open("wb") for i in range(20)]
        robot.stop()
        robot.close()
        for file in files:
            file.close()
    assert all(path.read_bytes() == b"" for path in tmp_path.iterdir())


def test_over_a_slow_link_nothing_is_let_move() -> None:
    with Emulated("latency@0:ms=150") as slow, bridge.open(slow.port) as robot:
        with pytest.raises(
            StoppedForSafetyError, match=r"round-trip time is 3\d\d ms \(limit 100 ms\)"
        ):
            robot.planner.start("paper")
        assert robot.session is State.READY, "to look on is no motion"
        with pytest.raises(StoppedForSafetyError, match="too slow for motion"):
            robot.enable()
        with pytest.raises(StoppedForSafetyError, match="too slow for motion"):
            robot.drive(0.1, 0.0)
        until(lambda: slow.holds(StopCause.LINK))
        assert slow.pose == Pose2(3.0, 3.0, 0.0)


def test_the_device_goes_away() -> None:
    with Emulated() as emulated, bridge.open(emulated.port) as robot:
        robot.enable()
        emulated.end()
        with pytest.raises((DeviceLostError, StoppedForSafetyError)):
            until(lambda: False, lambda: robot.drive(0.1, 0.0))


def test_a_port_that_is_not_there() -> None:
    with pytest.raises(PortError, match="/dev/no-such-port"):
        bridge.open("/dev/no-such-port")


def test_a_port_without_an_answer() -> None:
    with PtyPort() as silent:
        with pytest.raises(NoDeviceError, match=silent.path):
            bridge.open(silent.path, timeout_s=0.3)
        with pytest.raises(NoDeviceError):  # and the port was released
            bridge.open(silent.path, timeout_s=0.3)


def test_another_node_than_asked_for(emulated: Emulated) -> None:
    with pytest.raises(NoDeviceError):
        bridge.open(emulated.port, node=7, timeout_s=0.5)


# ---- how long a velocity holds ---------------------------------------------------------


def observed(time_s: float) -> Observation:
    return AT_REST._replace(time_s=time_s)


def test_a_velocity_holds_for_half_a_second() -> None:
    drive = ManualDrive()
    assert drive.step(observed(10.0)) == HALT
    command = VelocityCommand(0.1, 0.5)
    drive.drive(command, 20.0)
    steps = [drive.step(observed(20.0 + 0.02 * i)) for i in range(60)]
    assert steps.count(command) == round(SETPOINT_TIMEOUT_S / 0.02) + 1
    assert steps[:25] == [command] * 25
    assert steps[26:] == [HALT] * 34
    assert drive.target == HALT


def test_a_velocity_expires_while_no_step_uses_it() -> None:
    drive = ManualDrive()
    drive.drive(VelocityCommand(0.1, 0.5), 20.0)
    assert drive.step(observed(20.0 + SETPOINT_TIMEOUT_S + 0.1)) == HALT


def test_a_repeated_velocity_stays_in_effect() -> None:
    drive = ManualDrive()
    for i in range(200):
        command = VelocityCommand(0.001 * i, 0.0)
        if i % 20 == 0:
            reported = command
            drive.drive(reported, 0.02 * i)
        assert drive.step(observed(0.02 * i)) == drive.target == reported


# ---- other commands of a device --------------------------------------------------------------


def test_parameters_by_name(emulated: Emulated) -> None:
    with bridge.open(emulated.port) as robot:
        listed = robot.list_parameters()
        assert [p.number for p in listed] == list(range(len(listed)))
        speed = robot.get_parameter("max_speed")
        assert speed in listed
        assert (speed.unit, speed.changed) == ("m/s", False)
        assert robot.set_parameter("max_speed", 0.25).value == 0.25
        assert robot.get_parameter("max_speed").value == 0.25
        assert robot.get_parameter(speed.number).changed
        robot.save_parameters()
        assert robot.get_parameter("max_speed").stored
        with pytest.raises(ParameterError, match="did you mean max_speed"):
            robot.get_parameter("max_sped")
        with pytest.raises(ParameterError, match="not in"):
            robot.set_parameter("max_speed", 99.0)
        with pytest.raises(ParameterError, match="read-only"):
            robot.set_parameter("node", 3)
        with pytest.raises(CommandRejectedError, match="unknown_parameter"):
            robot.get_parameter(200)
        for number in (256, 300, -1, 10**3000):
            with pytest.raises(ParameterError, match="is not in 0 to 255"):
                robot.get_parameter(number)
        with pytest.raises(ParameterError, match="is not in 0 to 1000 Hz"):
            robot.stream_rate("imu", 10**3000)
        with pytest.raises(ParameterError, match="max_speed"):
            robot.set_parameter("max_speed", 10**3000)
        assert robot.get_parameter("max_speed").number == speed.number, "the session goes on"


def test_a_reboot_is_found_again_and_reported(emulated: Emulated) -> None:
    with bridge.open(emulated.port) as robot:
        until(lambda: robot.status.latest is not None)
        before = emulated.device.firmware.identity.boot_id
        robot.events()
        robot.set_parameter("max_speed", 0.25)
        robot.reboot()
        until(lambda: emulated.device.firmware.identity.boot_id != before)
        until(lambda: "new_boot" in {event.kind for event in robot.events()})
        until(lambda: robot.session is State.READY)
        assert robot.get_parameter("max_speed").value == pytest.approx(0.3), "it was not saved"


def test_a_failed_open_gives_the_port_back(emulated: Emulated) -> None:
    with pytest.raises(NoDeviceError):
        bridge.open(emulated.port, timeout_s=0)
    with bridge.open(emulated.port) as robot:
        with pytest.raises(BridgeError, match="unknown planner 1"):
            robot.planner.start(1)  # type: ignore[arg-type]  # as from a script without types
        assert robot.session is State.READY


def test_stream_rates(emulated: Emulated) -> None:
    with bridge.open(emulated.port) as robot:
        robot.stream_rate("imu", 0.0)
        another(robot.encoders)  # samples from before the acknowledgement have arrived
        still = robot.imu.latest
        for _ in range(30):  # at 100 Hz, as the IMU was: in 0.3 s of the device's time
            another(robot.encoders)
        assert robot.imu.latest is still
        robot.stream_rate("imu", 50.0)
        until(lambda: robot.imu.latest is not still)
        with pytest.raises(ParameterError, match="unknown stream"):
            robot.stream_rate("music", 1.0)
        with pytest.raises(ParameterError, match="0 switches a stream off"):
            robot.stream_rate("imu", 0.04)
        with pytest.raises(CommandRejectedError, match="bad_value"):
            robot.stream_rate("sync", 1.0)


def test_a_stop_is_cleared_by_a_person_and_nothing_moves(emulated: Emulated) -> None:
    with bridge.open(emulated.port) as robot:
        robot.stop()
        assert emulated.holds(StopCause.OPERATOR)
        assert robot.clear_stop() is StopCause.OPERATOR
        assert emulated.holds(StopCause.NONE)
        assert robot.clear_stop() in {StopCause.OPERATOR, StopCause.NONE}
        assert emulated.device.truth.path_m == 0.0


def test_the_devices_own_planner(emulated: Emulated) -> None:
    with bridge.open(emulated.port) as robot:
        with pytest.raises(BridgeError, match="use one of paper"):
            robot.planner.start("zigzag")
        robot.planner.start("paper")
        until(lambda: emulated.device.truth.v_m_s > 0.05)
        until(lambda: robot.planner.latest is not None and robot.planner.latest.phase != 0)
        robot.planner.pause()
        until(lambda: emulated.device.truth.v_m_s == 0.0)
        robot.planner.resume()
        until(lambda: emulated.device.truth.v_m_s > 0.05)
        robot.planner.abort()
        until(lambda: emulated.device.firmware.mode is Mode.IDLE)
        with pytest.raises(CommandRejectedError, match="other_mode"):
            robot.planner.pause()
        robot.stop()
        with pytest.raises((StoppedForSafetyError, DeviceLostError)):
            robot.planner.start("paper")


def test_another_program_reaches_it(emulated: Emulated) -> None:
    with bridge.open(emulated.port) as robot:
        until(lambda: robot.status.latest is not None)
        with reach(emulated.port) as other:
            assert isinstance(other, RemoteRobot)
            assert other.set_parameter("max_speed", 0.2).value == pytest.approx(0.2)
            assert other.list_parameters() == robot.list_parameters()
            picture = other.snapshot()
            assert picture["session"] == "ready"
            assert picture["stop"] == "session_end"
            other.stop()
        until(lambda: emulated.holds(StopCause.OPERATOR))
    with reach(emulated.port) as alone:
        assert isinstance(alone, Robot), "nobody owns it any more"


# ---- failures -------------------------------------------------------------------------------


class Fragile:
    """A sink that can be made to fail; the loop writes to it."""

    def __init__(self) -> None:
        self.broken = False

    def write(self, record: object) -> None:
        if self.broken:
            raise RuntimeError(f"no place for {type(record).__name__}")

    def close(self, summary: object = None) -> None:
        """Do nothing: there is nothing to close."""


def test_a_loop_that_fails_stops_the_robot_and_is_seen(emulated: Emulated) -> None:
    sink = Fragile()
    with bridge.open(emulated.port, sink=sink) as robot:
        robot.enable()
        until(lambda: emulated.device.truth.v_m_s > 0.05, lambda: robot.drive(0.1, 0.0))
        sink.broken = True
        until(lambda: not robot.enabled)
        assert emulated.holds(StopCause.SUPERVISE), "its loop has sent a stop"
        with pytest.raises(StoppedForSafetyError, match="RuntimeError: no place for"):
            robot.drive(0.1, 0.0)
        with pytest.raises(DeviceLostError, match="has ended"):
            robot.list_parameters()
        robot.stop()
        assert emulated.holds(StopCause.OPERATOR), "a stop needs no loop"
        sink.broken = False
        robot.enable(clear_stop=True)
        assert robot.enabled


def test_a_stop_that_the_device_does_not_confirm_is_raised() -> None:
    with Emulated() as emulated:
        robot = bridge.open(emulated.port)
        robot.enable()
        emulated.receive_only()
        with pytest.raises(NoDeviceError, match="no confirmation of the stop"):
            robot.stop()
        with pytest.raises(NoDeviceError, match="no confirmation of the stop"):
            robot.stop()
        assert not robot.enabled
        robot.close()


def test_a_stop_of_a_closed_robot_is_sent_all_the_same(emulated: Emulated) -> None:
    robot = bridge.open(emulated.port)
    robot.close()
    assert emulated.holds(StopCause.SESSION_END)
    robot.stop()
    assert emulated.holds(StopCause.OPERATOR)
    with pytest.raises(StoppedForSafetyError, match="closed"):
        robot.enable(clear_stop=True)


def test_a_stop_from_another_program_during_an_orderly_end(emulated: Emulated) -> None:
    """A program that gets the confirmation of the stop finds the stop latched."""
    for _ in range(5):
        robot = bridge.open(emulated.port)
        closing = threading.Thread(target=robot.close)
        closing.start()
        try:
            with reach(emulated.port) as other:
                other.stop()
            latched = emulated.holds(StopCause.OPERATOR)
        except BridgeError:
            latched = True  # the stop was not confirmed
        closing.join()
        assert latched
        with bridge.open(emulated.port) as fresh:
            fresh.clear_stop()


def test_a_program_records_and_the_log_is_whole(emulated: Emulated, tmp_path: Path) -> None:
    log = tmp_path / "drive.mcap"
    with bridge.open(emulated.port) as robot:
        with robot.record(log, room=PLAN) as recording:
            robot.enable()
            until(lambda: robot.pose.x_m > 0.03, lambda: robot.drive(0.1, 0.0))
            assert recording.error is None
            assert "accel_z_m_s2=" in repr(robot.imu)
            assert ": ready, driving, x_m=0.0" in repr(robot)
            assert repr(robot.planner).startswith("<planner of the device: ")
        assert recording.dropped == 0
        after = log.stat().st_size
        with pytest.raises(OutputExistsError, match="force=True"):
            robot.record(log)
        assert log.stat().st_size == after
        again = robot.record(tmp_path / "again.mcap")
        robot.stop()
        robot.enable(clear_stop=True)  # another session, into the same log
    again.close()  # the robot has closed it
    reader = LogReader(log)
    assert not reader.truncated
    assert {"room.json", "robot.toml", "summary.json"} <= set(reader.attachments)
    topics = {message.topic for message in reader.messages()}
    assert {"/device/imu", "/raw/uart/rx", "/cmd", "/pose", "/map/room"} <= topics
    second = LogReader(tmp_path / "again.mcap")
    assert not second.truncated
    assert json.loads(second.attachments["summary.json"])["log"].endswith("again.mcap")


def test_clock_changes_do_not_shift_times_within_a_log(
    emulated: Emulated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system clock is set before the first log, and once more while it is written."""
    hour_ns = 3_600_000_000_000
    offset_ns = clock.unix_offset_ns()
    with bridge.open(emulated.port) as robot:
        for hours, name in ((1, "first"), (2, "second")):
            set_ns = offset_ns + hours * hour_ns
            monkeypatch.setattr(clock, "unix_offset_ns", lambda set_ns=set_ns: set_ns)
            robot.record(tmp_path / f"{name}.mcap")
            another(robot.encoders)
            another(robot.encoders)
    for name in ("first", "second"):
        reader = LogReader(tmp_path / f"{name}.mcap")
        since_ns = [m.log_ns - offset_ns - hour_ns for m in reader.messages()]
        assert max(since_ns) - min(since_ns) < hour_ns / 2, "no step"
        assert abs(since_ns[0] - clock.now()) < hour_ns / 2


def test_a_log_that_fails_is_an_error_at_the_end_and_no_stop(emulated: Emulated) -> None:
    full = Path("/dev/full")
    with bridge.open(emulated.port) as robot:
        with pytest.raises(LogError):
            robot.record(full / "x.mcap")
        until(lambda: robot.imu.latest is not None)


def test_eight_clients_and_the_program_ask_for_parameters_at_once(emulated: Emulated) -> None:
    """Each gets the answer to its own question: none takes the answer of another."""
    wrong: list[str] = []

    def ask_often(robot: Robot | RemoteRobot, seed: int) -> None:
        names = random.Random(seed)
        try:
            listed = robot.list_parameters()
            for _ in range(20):
                chosen = names.choice(listed)
                found = robot.get_parameter(names.choice((chosen.name, chosen.number)))
                if found != chosen:
                    wrong.append(f"{found} is not {chosen}")
        except Exception as error:  # noqa: BLE001 - the result
            wrong.append(repr(error))

    with bridge.open(emulated.port) as robot:
        clients = [RemoteRobot(emulated.port) for _ in range(7)]
        threads = [
            threading.Thread(target=ask_often, args=(client, seed))
            for seed, client in enumerate([*clients, robot])
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE_S)
        assert wrong == []
        assert robot.session is State.READY
