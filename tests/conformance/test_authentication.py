"""A device with a key obeys each signed command once, no unsigned command, and every stop."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from protocol.authentication import Authenticator
from protocol.messages.device import Ack
from protocol.messages.host import SetMode, SetStreamRate, Stop
from protocol.messages.values import Mode, NackReason, StopCause

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.probe import Probe

pytestmark = pytest.mark.keyed

STATUS, SET_STREAM_RATE = 0x11, 0x0D
ANSWER_S = 0.4
"""Maximum time for an answer, s."""
TURN_RAD_S = 0.6
AHEAD = 50
"""Number of frames by which a counter is ahead of the newest that the device has accepted."""


@contextmanager
def signed_with(device: Probe, key: Authenticator | None) -> Iterator[None]:
    """Sign with another key inside the context, or not at all if the key is None."""
    own, device.link.key = device.link.key, key
    try:
        yield
    finally:
        device.link.key = own


def command(device: Probe, command_id: int) -> bytes:
    """Return the bytes of a command, signed if the probe signs, without sending them."""
    assert device.node is not None
    device.link.send(SetStreamRate(command_id, STATUS, 500), 0, node=device.node)
    return device.link.data_to_send()


def is_obeyed(device: Probe, data: bytes, command_id: int) -> bool:
    """Write the bytes of a command; return whether the device acknowledges it."""
    mark = len(device.received)
    device.write(data)
    device.until(lambda: bool(device.replies(command_id, SET_STREAM_RATE, mark)), ANSWER_S)
    return any(isinstance(r, Ack) for r in device.replies(command_id, SET_STREAM_RATE, mark))


def test_a_signed_command_is_obeyed(device: Probe) -> None:
    device.handshake()
    command_id = device.next_id()
    assert is_obeyed(device, command(device, command_id), command_id)


def test_an_unsigned_command_is_rejected(device: Probe) -> None:
    device.handshake()
    with signed_with(device, None):
        reason = device.refusal(lambda i: SetMode(i, Mode.IDLE))
    assert reason is NackReason.NOT_AUTHENTICATED


@pytest.mark.motion
def test_an_unsigned_setpoint_moves_nothing(device: Probe) -> None:
    device.handshake()
    device.enter(Mode.VELOCITY)
    before = device.counters().stale
    mark = len(device.received)
    with signed_with(device, None):
        device.keep_saying(lambda: device.setpoint(0.0, TURN_RAD_S), 0.2)
    assert device.status().setpoint_remaining == 0
    counted = [(left, right) for _, left, right in device.counts()]
    assert counted[-1] == counted[0], "an unsigned setpoint moved the robot"
    assert len(device.received) > mark
    assert (device.counters().stale - before) % 0x10000 >= 3, "drops not counted as stale"
    device.stop()


def test_a_command_with_another_key_is_not_obeyed(device: Probe) -> None:
    device.handshake()
    other = Authenticator(bytes(16))
    other.begin(*device.nonce)
    command_id = device.next_id()
    with signed_with(device, other):
        for _ in range(AHEAD):  # the counter becomes new, so that only the tag is wrong
            command(device, command_id)
        data = command(device, command_id)
    assert not is_obeyed(device, data, command_id), "obeyed with a wrong tag"


def test_a_replayed_command_is_not_obeyed(device: Probe) -> None:
    device.handshake()
    command_id = device.next_id()
    data = command(device, command_id)
    assert is_obeyed(device, data, command_id)
    assert not is_obeyed(device, data, command_id), "the same signed bytes were obeyed again"


def test_a_command_of_an_earlier_session_is_not_obeyed(device: Probe) -> None:
    device.handshake()
    command_id = device.next_id()
    data = command(device, command_id)
    assert is_obeyed(device, data, command_id)
    device.handshake()
    assert not is_obeyed(device, data, command_id), "a command of an earlier session was obeyed"


def test_a_stop_needs_no_tag(device: Probe) -> None:
    device.handshake()
    with signed_with(device, None):
        assert device.refusal(lambda i: Stop(i, StopCause.OPERATOR)) is None
    assert device.status().stop_cause == StopCause.OPERATOR
