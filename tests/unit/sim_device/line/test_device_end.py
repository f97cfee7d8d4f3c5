"""The device counts errors of its link, and reports them in its link counters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocol.can.frames import RECORD
from protocol.can.link import CanLink
from protocol.messages.device import LinkCounters
from protocol.messages.values import ResetCause
from protocol.uart.link import Link
from sim_device.device.counters import LineHealth
from sim_device.line.can_controller import CanController
from sim_device.line.device_end import DeviceEnd
from sim_device.line.line import CAN_QUEUE, CanChannel, LineSettings, UartUp
from support.rigs import Drive, rig

if TYPE_CHECKING:
    from sim_device.rig import Rig

pytestmark = pytest.mark.usefixtures("target")

SERIAL = LineSettings()
BUS = LineSettings(bitrate=500_000)


def counters(made: Rig, seconds: float) -> list[LinkCounters]:
    """Run a session; return the link counters that the host receives."""
    drive = Drive(made)
    drive.run(seconds)
    return [h.message for h in drive.received if isinstance(h.message, LinkCounters)]


def of_the_line(message: LinkCounters) -> tuple[int, ...]:
    """Return all counters except those of received frames."""
    return tuple(message)[3:]


@pytest.mark.parametrize("settings", [SERIAL, BUS], ids=["uart", "can"])
def test_a_good_line_counts_nothing(settings: LineSettings) -> None:
    link = CanLink if settings.bitrate else Link
    found = counters(rig(settings=settings, link=link), 5.0)
    assert len(found) >= 3
    assert {of_the_line(message) for message in found} == {(0, 0, 0, 0, 0)}


def test_frames_that_find_no_room_in_the_transmit_buffer_are_counted() -> None:
    up = UartUp(SERIAL.baud, SERIAL.latency_us, lambda data: data)
    end = DeviceEnd(up, None)
    frame = b"\0" + bytes(range(1, 31)) + b"\0"
    up.push(frame * 128, 0)  # 4096 bytes fill the buffer
    assert end.health() == LineHealth()
    up.push(frame * 3, 0)
    assert end.health() == LineHealth(send_dropped=3)
    up.push(frame * 2, 200)  # 18 bytes are sent, so one frame is cut and one is lost
    assert end.health() == LineHealth(send_dropped=5)
    end.boot()
    assert end.health() == LineHealth()


def test_frames_that_find_no_room_in_the_queue_to_the_bus_are_counted() -> None:
    bus = CanChannel(BUS.bitrate, 0, lambda record: [record])
    end = DeviceEnd(bus, CanController())
    bus.push(bytes(RECORD.size) * (CAN_QUEUE + 5), 0)
    assert end.health() == LineHealth(send_dropped=5)


def test_a_bus_off_is_counted_and_its_errors_are_gone_afterwards() -> None:
    found = counters(rig("can-bus-off@4:0.2", settings=BUS, link=CanLink), 8.0)
    assert [message.can_bus_offs for message in found][:2] == [0, 0]
    assert of_the_line(found[-1]) == (0, 0, 0, 0, 1)


def test_damaged_frames_raise_the_error_counters() -> None:
    found = counters(rig("bit-flips@2:20:rate=0.004,way=up", settings=BUS, link=CanLink), 10.0)
    assert max(message.can_send_errors for message in found) > 8
    assert {message.can_receive_errors for message in found} == {0}
    found = counters(rig("bit-flips@2:20:rate=0.03,way=down", settings=BUS, link=CanLink), 10.0)
    assert max(message.can_receive_errors for message in found) > 0
    assert {message.can_send_errors for message in found} == {0}


def test_a_boot_begins_at_zero() -> None:
    made = rig("can-bus-off@4:0.2", settings=BUS, link=CanLink)
    drive = Drive(made)
    drive.run(7.0)
    made.device.reset(ResetCause.PIN)
    before = len(drive.received)
    drive.run(10.0)
    after = [h.message for h in drive.received[before:] if isinstance(h.message, LinkCounters)]
    assert of_the_line(after[-1]) == (0, 0, 0, 0, 0)


# ---- the controller ---------------------------------------------------------------------------


def test_an_error_of_the_sender_counts_eight_and_a_good_frame_takes_one_away() -> None:
    controller = CanController()
    controller.sent(good=False)
    controller.sent(good=True)
    assert (controller.send_errors, controller.receive_errors) == (7, 0)
    controller.received(good=False)
    assert (controller.send_errors, controller.receive_errors) == (7, 1)
    controller.received(good=True)
    controller.received(good=True)
    assert controller.receive_errors == 0


def test_at_256_it_leaves_the_bus_and_shows_255() -> None:
    controller = CanController()
    for _ in range(31):
        controller.sent(good=False)
    assert (controller.send_errors, controller.is_off) == (248, False)
    controller.sent(good=False)
    assert (controller.send_errors, controller.is_off, controller.offs) == (255, True, 1)
    controller.sent(good=True)
    controller.leave()
    assert (controller.send_errors, controller.offs) == (255, 1)
    controller.rejoin()
    assert (controller.send_errors, controller.is_off, controller.offs) == (0, False, 1)


def test_receive_errors_stop_where_they_change_nothing() -> None:
    controller = CanController()
    for _ in range(300):
        controller.received(good=False)
    assert (controller.receive_errors, controller.is_off) == (127, False)
