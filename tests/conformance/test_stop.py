"""A stop is latched, acknowledged, and cleared only by the name of its cause."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest

from protocol.messages.device import Ack, Status
from protocol.messages.host import ClearStop, Describe, SetMode, Stop, StopAll, TimeRequest
from protocol.messages.values import Mode, NackReason, StopCause, by_severity
from support.probe import now_us

if TYPE_CHECKING:
    from support.probe import Probe

GRAVE = (StopCause.SUPERVISE, StopCause.OPERATOR, StopCause.HARDWARE)
STOP = 0x01


def clear(device: Probe, cause: int) -> NackReason | None:
    return device.refusal(lambda i: ClearStop(i, cause))


def acknowledged(device: Probe, ids: tuple[int, ...], mark: int) -> bool:
    return all(device.replies(i, STOP, mark) == [Ack(i, STOP)] for i in ids)


def test_a_stop_is_latched_and_leaves_every_mode(device: Probe) -> None:
    device.handshake()
    device.free()
    device.stop(StopCause.OPERATOR)
    status = device.status()
    assert (status.mode, status.stop_cause) == (Mode.IDLE, StopCause.OPERATOR)
    device.listen(0.2)
    assert device.refusal(lambda i: SetMode(i, Mode.VELOCITY)) is NackReason.STOP_LATCHED
    assert device.status().stop_cause == StopCause.OPERATOR, "the latch does not hold"


def test_every_repetition_is_acknowledged(device: Probe) -> None:
    device.handshake()
    command_id = device.next_id()
    mark = len(device.received)
    for _ in range(4):
        device.send(Stop(command_id, StopCause.OPERATOR))
    device.until(lambda: len(device.replies(command_id, STOP, mark)) >= 4, 1.0)
    device.ping()
    assert device.replies(command_id, STOP, mark) == [Ack(command_id, STOP)] * 4


def reported(device: Probe, cause: StopCause, mark: int) -> bool:
    """Return whether a status with this cause has arrived."""
    return any(status.stop_cause == cause for status in device.of(Status, mark))


def test_a_stop_of_every_device_is_latched_as_the_operators(device: Probe) -> None:
    device.handshake()
    device.free()
    mark = len(device.received)
    device.send(StopAll(), node=0)
    assert device.until(lambda: reported(device, StopCause.OPERATOR, mark), 1.0), "no status"
    assert device.status().mode == Mode.IDLE
    assert not device.of(Ack, mark), "a stop without an id was acknowledged"
    device.free()


@pytest.mark.slow
def test_a_stop_of_every_device_is_answered_outside_a_session(device: Probe) -> None:
    device.handshake()
    device.session_id = 0
    device.listen(1.3, alive=False)  # the session is over
    for _ in range(2):  # equal bytes, a little later
        mark = len(device.received)
        device.send(StopAll(), node=0)
        answered = device.until(
            lambda m=mark: reported(device, StopCause.OPERATOR, m),  # type: ignore[misc]  # bound now
            0.5,
            alive=False,
        )
        assert answered, "no status answered the stop"
    device.handshake()
    device.free()


@pytest.mark.slow
def test_it_is_obeyed_and_acknowledged_outside_a_session(device: Probe) -> None:
    device.handshake()
    device.free()
    device.session_id = 0
    device.listen(1.3, alive=False)  # the session is over
    command_id = device.next_id()
    device.reply_to(Stop(command_id, StopCause.HARDWARE))
    device.handshake()
    assert device.status().stop_cause == StopCause.HARDWARE
    device.free()


def test_the_graver_of_two_stops_that_coincide_is_latched(device: Probe) -> None:
    device.handshake()
    for first, second in itertools.product(by_severity(), repeat=2):
        device.free()
        ids = device.next_id(), device.next_id()
        mark = len(device.received)
        for command_id, cause in zip(ids, (first, second), strict=True):
            device.send(Stop(command_id, cause))
        pair = f"{first.name.lower()}, then {second.name.lower()}"
        assert device.until(lambda i=ids, m=mark: acknowledged(device, i, m), 1.0), pair  # type: ignore[misc]  # bound now
        assert device.status().stop_cause == max(first, second), pair
        if first is not second:
            assert clear(device, min(first, second)) is NackReason.OTHER_CAUSE, pair
            assert device.status().stop_cause == max(first, second), pair
    device.free()


def test_a_cause_without_a_name_counts_as_the_operators(device: Probe) -> None:
    device.handshake()
    for cause in (0, 6, 200):
        device.free()
        device.reply_to(Stop(device.next_id(), cause))
        assert device.status().stop_cause == StopCause.OPERATOR, f"cause {cause}"


@pytest.mark.parametrize("cause", GRAVE)
def test_only_its_own_name_clears_it(device: Probe, cause: StopCause) -> None:
    device.handshake()
    device.free()
    device.stop(cause)
    for other in set(StopCause) - {cause, StopCause.NONE}:
        assert clear(device, other) is NackReason.OTHER_CAUSE, f"cleared as {other.name.lower()}"
    assert device.status().stop_cause == cause
    assert clear(device, cause) is None
    assert device.status().stop_cause == StopCause.NONE


def test_to_clear_where_nothing_is_latched_is_no_error(device: Probe) -> None:
    device.handshake()
    device.free()
    assert clear(device, StopCause.OPERATOR) is None
    assert device.status().stop_cause == StopCause.NONE


def test_another_sessions_hello_stops_a_robot_that_was_free(device: Probe) -> None:
    device.handshake()
    device.free()
    device.handshake()
    status = device.status()
    assert (status.mode, status.stop_cause) == (Mode.IDLE, StopCause.LINK)


def test_another_sessions_hello_keeps_the_cause_of_a_robot_that_was_not(device: Probe) -> None:
    device.handshake()
    device.free()
    device.stop(StopCause.SESSION_END)
    device.handshake()
    assert device.status().stop_cause == StopCause.SESSION_END, "an orderly end became a lost link"


@pytest.mark.slow
def test_a_silent_host_is_a_lost_link(device: Probe) -> None:
    device.handshake()
    device.free()
    session, device.session_id = device.session_id, 0
    device.listen(0.6, alive=False)
    device.session_id = session
    assert device.status().stop_cause == StopCause.NONE, "0.6 s of silence ended the link"
    device.session_id = 0
    silent_us = now_us()
    received = device.listen(1.4, alive=False)
    late = [h for h in received if h.at_us - silent_us > 1_200_000]
    reported = {type(h.message).__name__ for h in late} - {"Hello"}
    assert not reported, f"1.2 s after the host's last frame: {sorted(reported)}"
    device.handshake()
    assert device.status().stop_cause == StopCause.LINK


@pytest.mark.slow
def test_any_frame_of_the_host_keeps_the_link(device: Probe) -> None:
    device.handshake()
    device.free()
    for ping in range(8):
        device.send(TimeRequest(ping))
        device.listen(0.25, alive=False)
    assert device.status().stop_cause == StopCause.NONE


@pytest.mark.slow
def test_frames_that_are_not_for_it_do_not_keep_it(device: Probe) -> None:
    device.handshake()
    device.free()
    other = 15 if device.node != 15 else 14
    session, device.session_id = device.session_id, 0
    for ping in range(14):
        device.send(TimeRequest(ping), node=other)
        device.send(Describe(STOP, 0), node=0)
        device.listen(0.1, alive=False)
    device.session_id = session
    device.handshake()
    assert device.status().stop_cause == StopCause.LINK
