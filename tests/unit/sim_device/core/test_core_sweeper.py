"""The C core on a virtual board, as a device of the simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from bridge.motion.robot_model import RobotModel
from protocol.can.link import CanLink
from protocol.messages.device import Ack, Imu, LogText, Nack, ParameterValue, Status
from protocol.messages.host import (
    GetParameter,
    HostHello,
    Reboot,
    SaveParameters,
    SetKey,
    SetParameter,
)
from protocol.messages.values import (
    Fault,
    Mode,
    NackReason,
    ParameterKind,
    RebootKind,
    ResetCause,
    StopCause,
)
from protocol.parameter_values import from_raw
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link
from sim_device.core.core_sweeper import CoreSweeper
from sim_device.device.modes import DeviceState
from sim_device.faults.kinds import parse_fault
from sim_device.faults.spec import FaultSpecError
from sim_device.line.line import LineSettings
from sim_device.rig import Rig
from sim_device.sweeper import VirtualSweeper
from support.rigs import OPEN_FLOOR, Drive
from support.wire_host import WireHost

if TYPE_CHECKING:
    from protocol.link import LinkBase
    from sim_device.sweeper import Sweeper

MAX_SPEED, CLIFF_REFLEX = 4, 21
V_M_S = 0.2


def device(
    model: RobotModel | None = None, *, node: int = 1, link: type[LinkBase] = Link
) -> CoreSweeper:
    return CoreSweeper(OPEN_FLOOR, model, noise="none", seed=1, node=node, link=link)


def on_core(*faults: str, link: type[LinkBase] = Link) -> Rig:
    return Rig(device(link=link), faults=[parse_fault(text) for text in faults], seed=1)


# ---- the same behaviour as the Python model ----------------------------------------------


@pytest.mark.parametrize("link", [Link, CanLink])
def test_it_drives_as_the_python_device_does(link: type[LinkBase]) -> None:
    python = VirtualSweeper(OPEN_FLOOR, noise="none", seed=1, link=link)
    ways = []
    for rig in (on_core(link=link), Rig(python, seed=1)):
        drive = Drive(rig, V_M_S, 0.3)
        drive.run(6.0)
        ways.append(rig.plant.pose)
    assert ways[0].distance_m(ways[1]) < 1e-3
    assert ways[0].theta_rad == pytest.approx(ways[1].theta_rad, abs=2e-3)


def test_equal_seeds_give_equal_bytes() -> None:
    def lived() -> list[tuple[int, bytes]]:
        drive = Drive(on_core("bit-flips@1:3:rate=0.001"), V_M_S)
        drive.run(5.0)
        return drive.bytes

    assert lived() == lived()


def test_devices_of_one_process_do_not_share_anything() -> None:
    moving, still = WireHost(device()), WireHost(device(node=2))
    for host in (moving, still):
        host.run(0.1)
    moving.join()
    assert moving.clear() is None
    assert moving.choose(Mode.VELOCITY) is None
    assert (moving.device.mode, still.device.mode) == (Mode.VELOCITY, Mode.IDLE)
    assert moving.device.stop_cause is StopCause.NONE
    assert still.device.stop_cause is StopCause.SESSION_END


def test_the_robot_file_is_in_its_flash() -> None:
    host = WireHost(device(RobotModel(max_speed_m_s=0.25)))
    host.join()
    assert host.ask(lambda i: GetParameter(i, MAX_SPEED)) is None
    value = host.last(ParameterValue)
    assert from_raw(ParameterKind.F32, value.value) == pytest.approx(0.25)


# ---- serial link and CAN bus ---------------------------------------------------------------


def test_a_line_that_is_too_slow_loses_whole_frames_and_no_answer() -> None:
    """The core checks the free space of the transmit buffer, so frames are never cut."""
    rig = Rig(device(), LineSettings(baud=19_200), seed=1)
    drive = Drive(rig)
    drive.run(12.0)
    assert rig.counts().device_overrun == 0
    assert drive.session.link.statistics.damaged == 0
    assert 500 < len(drive.received) < 1_500, "a fast link carries 2 500"
    assert drive.round_trips_us(6.0, 12.0), "a part of the buffer is reserved for answers"


def test_frames_that_wait_for_the_bus_leave_by_their_rank() -> None:
    """On a slow bus, streams overtake parameters, which have the lowest priority."""
    rig = Rig(device(link=CanLink), LineSettings(bitrate=125_000), seed=1)
    host: WireHost[Any] = WireHost(rig)
    host.link = CanLink(Direction.HOST)  # type: ignore[assignment]  # any link will do
    host.run(1.5)
    for negotiated in (0, 1):
        host.send(HostHello(CATALOGUE.hash, 7, host.hello.boot_id, negotiated, "frames"))
        host.run(0.5)
    asked_us = host.now_us
    host.send(*(GetParameter(number, number) for number in range(6)))
    host.run(0.5)
    after = [(at_us - t_us, m) for at_us, t_us, m in host.received if at_us > asked_us]
    kinds = [type(message) for _, message in after]
    values = [i for i, kind in enumerate(kinds) if kind is ParameterValue]
    assert len(values) == 6
    assert Imu in kinds[values[0] : values[-1]], "a sample overtakes the queued values"
    assert max(late_us for late_us, message in after if isinstance(message, Imu)) < 15_000


@pytest.mark.parametrize("local", [True, False])
def test_a_key_is_set_only_beside_the_robot(*, local: bool) -> None:
    made = CoreSweeper(OPEN_FLOOR, noise="none", seed=1, local=local)
    host = WireHost(made)
    host.join()
    assert host.clear() is None
    host.send(SetKey(77, 1, 2, 3, 4))
    host.run(0.6)
    if local:
        assert host.last(Ack).command_id == 77
        assert made.firmware.view.keyed
    else:
        assert host.last(Nack).reason == NackReason.UNSUPPORTED
        assert not made.firmware.view.keyed


# ---- resets and faults -------------------------------------------------------------------


def test_parameters_outlive_a_reboot_and_a_lost_supply_keeps_the_old_ones() -> None:
    host = WireHost(device())
    host.join()
    assert host.ask(lambda i: SetParameter(i, CLIFF_REFLEX, ParameterKind.U32, 0)) is None
    assert host.clear() is None
    host.send(SaveParameters(77))
    host.run(0.5)
    host.send(SetParameter(78, CLIFF_REFLEX, ParameterKind.U32, 1), SaveParameters(79))
    host.run(0.1)  # shorter than erasing a page
    host.device.reset(ResetCause.BROWN_OUT)
    host.run(1.5)
    host.join()
    assert host.ask(lambda i: GetParameter(i, CLIFF_REFLEX)) is None
    assert host.last(ParameterValue).value == 0


def test_a_factory_reset_forgets_and_takes_its_time() -> None:
    host = WireHost(device(RobotModel(max_speed_m_s=0.25)))
    host.join()
    assert host.clear() is None
    assert host.ask(lambda i: Reboot(i, RebootKind.FACTORY_RESET)) is None
    boot_id = host.hello.boot_id
    host.run(1.5)
    host.join()
    assert host.hello.boot_id != boot_id
    assert host.hello.reset_cause == ResetCause.SOFTWARE
    assert host.ask(lambda i: GetParameter(i, MAX_SPEED)) is None
    value = from_raw(ParameterKind.F32, host.last(ParameterValue).value)
    assert value == pytest.approx(RobotModel().max_speed_m_s)


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("reset@3", ResetCause.PIN),
        ("hang@3", ResetCause.WATCHDOG),
        ("crash@3", ResetCause.CRASH),
        ("brown-out@3:off=0.2", ResetCause.BROWN_OUT),
        ("hse-failed@3", ResetCause.CRASH),
    ],
)
def test_each_reset_has_its_cause(fault: str, cause: ResetCause) -> None:
    drive = Drive(on_core(fault), V_M_S)
    drive.run(6.0)
    first, *_, last = drive.negotiated()
    assert last.hello.boot_id != first.hello.boot_id
    assert last.hello.reset_cause == cause


def test_a_hung_program_keeps_its_duties_until_the_watchdog_fires() -> None:
    drive = Drive(on_core("hang@3"), V_M_S)
    drive.run(3.09)
    assert drive.rig.truth.v_m_s == pytest.approx(V_M_S, abs=0.02)
    drive.run(3.4)
    assert drive.rig.truth.v_m_s < V_M_S / 2


def test_a_crash_is_in_its_log() -> None:
    drive = Drive(on_core("crash@3"), V_M_S)
    drive.run(6.0)
    assert any(m.line.startswith("crash after ") for m in drive.of(LogText, 3.0))


def test_a_stuck_bus_gives_no_new_samples() -> None:
    drive = Drive(on_core("i2c-stuck@3:1"))
    drive.run(5.0)
    assert len(drive.of(Imu, 2.0, 3.0)) == pytest.approx(100, abs=1)
    assert drive.of(Imu, 3.1, 4.0) == []
    assert len(drive.of(Imu, 4.1, 5.0)) == pytest.approx(90, abs=1)


def test_a_dead_crystal_is_a_fault_bit() -> None:
    drive = Drive(on_core("hse-failed@2"))
    drive.run(6.0)
    assert all(Fault.CLOCK in Fault(m.faults) for m in drive.of(Status, 5.0))


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("encoder-reversed@0:side=left", Fault.ENCODER_LEFT_REVERSED),
        ("encoder-reversed@0:side=right", Fault.ENCODER_RIGHT_REVERSED),
        ("encoder-swapped@0", Fault.ENCODERS_SWAPPED),
    ],
)
@pytest.mark.parametrize("firmware", ["core", "python"])
def test_a_miswired_encoder_ends_at_rest_with_the_drivers_off(
    firmware: str, fault: str, named: Fault
) -> None:
    """On a curve the wheels differ, so the signs of duties and counts identify the fault."""
    made = device() if firmware == "core" else VirtualSweeper(OPEN_FLOOR, noise="none", seed=1)
    rig = Rig(made, faults=[parse_fault(fault)], seed=1)
    drive = Drive(rig, V_M_S, 1.5)
    drive.run(8.0)
    assert made.stop_cause is StopCause.HARDWARE
    assert abs(made.truth.v_m_s) < 0.001
    assert not made.drivers
    begun = rig.plant.pose
    drive.run(12.0)
    assert rig.plant.pose.distance_m(begun) < 0.001, "the robot stays at rest"
    statuses = [h.message for h in drive.received if isinstance(h.message, Status)]
    assert any(status.faults & named for status in statuses)
    assert statuses[-1].faults & Fault.DRIVERS_OFF
    lines = [h.message.line for h in drive.received if isinstance(h.message, LogText)]
    assert any("encoder" in line for line in lines), lines


def test_its_clock_may_drift() -> None:
    drive = Drive(on_core("clock-drift@0:ppm=5000"))
    drive.run(10.0)
    received = [h for h in drive.received if isinstance(h.message, Imu)]
    assert received[-1].t_us / received[-1].at_us == pytest.approx(1.005, abs=2e-4)


def test_a_fault_that_a_chip_cannot_have_is_rejected_by_name() -> None:
    with pytest.raises(FaultSpecError, match="one counter"):
        on_core("clock-jump@1:ms=5")


@pytest.mark.parametrize("made", [device(), VirtualSweeper(OPEN_FLOOR, noise="none")])
def test_a_chip_without_supply_is_off(made: Sweeper[Any]) -> None:
    made.step(b"", 100_000)
    made.reset(ResetCause.POWER_ON, off_s=0.5)
    states = [made.state]
    made.step(b"", 2_000_000)
    states.append(made.state)
    assert states == [DeviceState.OFF, DeviceState.STOPPED]
