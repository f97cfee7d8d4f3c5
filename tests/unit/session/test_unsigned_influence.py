"""Attacks on a device through its serial link, without its key or without a session."""

from __future__ import annotations

import struct

import pytest

from protocol.authentication import Authenticator
from protocol.link import Received
from protocol.messages.device import Ack, Challenge, Hello
from protocol.messages.host import (
    ClearStop,
    Describe,
    HostHello,
    SetMode,
    Stop,
    TimeRequest,
    VelocitySetpoint,
)
from protocol.messages.values import Mode, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction, Message
from protocol.uart.framing import FLAG_AUTHENTICATED, encode_frame
from protocol.uart.link import Link
from support.ends import sweeper

KEY = bytes(range(1, 17))
SESSION = 77
STOP, HOST_HELLO = 0x01, 0x04
SPAN_US = 1 << 32
LATE_US = 9_900_000


class Line:
    """A device, a host whose time stamps the test chooses, and an attacker without the key."""

    def __init__(self, key: bytes | None) -> None:
        self.device = sweeper()
        self.device.flash.key = key
        self.device.firmware.keyring.take()
        self.host, self.stranger = Link(Direction.HOST), Link(Direction.HOST)
        self.host.key = None if key is None else Authenticator(key)
        self._ears = Link(Direction.HOST)
        self.now_us = 0
        self.received: list[Message] = []
        self.wait(1_000_000)

    def wait(self, for_us: int, data: bytes = b"") -> None:
        self.now_us += for_us
        out = self.device.step(data, self.now_us)
        for event in self._ears.receive(out, self.now_us):
            if isinstance(event, Received):
                self.received.append(event.message)

    def inform(self, link: Link, message: Message, late_us: int = 0) -> None:
        link.send(message, (self.now_us - late_us) % SPAN_US, node=1)
        self.wait(20_000, link.data_to_send())

    @property
    def boot_id(self) -> int:
        return self.device.firmware.identity.boot_id

    def begin(self) -> None:
        self.inform(self.host, HostHello(CATALOGUE.hash, SESSION, self.boot_id, 0, "host"))
        hello = next(m for m in reversed(self.received) if isinstance(m, Hello))
        if self.host.key is not None:
            challenge = next(m for m in reversed(self.received) if isinstance(m, Challenge))
            self.host.key.begin(hello.boot_id, SESSION, challenge.counter)
        self.inform(self.host, HostHello(CATALOGUE.hash, SESSION, self.boot_id, 1, "host"))
        self.inform(self.host, ClearStop(1, StopCause.SESSION_END))
        self.inform(self.host, SetMode(2, Mode.VELOCITY))

    @property
    def moving(self) -> bool:
        return abs(self.device.plant.truth.v_m_s) > 1e-3

    @property
    def cause(self) -> StopCause:
        return self.device.firmware.latch.cause


def test_stamps_of_unsigned_frames_make_no_old_setpoint_fresh() -> None:
    """Three unsigned pings try to advance the device's copy of the host clock by almost 2³² µs."""
    line = Line(KEY)
    line.begin()
    for ahead_us in (0x5555_0000, 0xAAAA_0000, SPAN_US - LATE_US - 100_000):
        line.inform(line.stranger, TimeRequest(1), late_us=-ahead_us)
    for counter in range(50):
        line.inform(line.host, VelocitySetpoint(2000, 0, 200, counter), late_us=LATE_US)
        assert not line.moving
    for counter in range(50, 100):
        line.inform(line.host, VelocitySetpoint(2000, 0, 200, counter))
    assert line.moving  # unsigned frames do not make a fresh setpoint old either


def test_a_rejected_frame_keeps_no_session_alive() -> None:
    line = Line(KEY)
    line.begin()
    for counter in range(80):
        line.inform(line.stranger, VelocitySetpoint(2000, 0, 200, counter))
    assert line.cause is StopCause.LINK
    assert not line.device.firmware.negotiated


@pytest.mark.parametrize("key", [None, KEY], ids=["no key", "key"])
@pytest.mark.parametrize("fields", range(5))
def test_questions_about_a_hello_cannot_lock_hosts_out(fields: int, key: bytes | None) -> None:
    line = Line(key)
    line.inform(line.stranger, Describe(HOST_HELLO, fields))
    line.begin()
    assert line.device.firmware.negotiated
    assert line.device.firmware.session_id == SESSION


@pytest.mark.parametrize("key", [None, KEY], ids=["no key", "key"])
def test_a_stop_with_a_wrong_tag_is_a_stop(key: bytes | None) -> None:
    line = Line(key)
    line.begin()
    payload = struct.pack("<HB", 900, StopCause.OPERATOR)
    for tag in (b"", bytes(12)):
        line.received.clear()
        line.wait(20_000, encode_frame(1, STOP, 0, 0, payload + tag, FLAG_AUTHENTICATED))
        assert line.cause is StopCause.OPERATOR
        assert Ack(900, STOP) in line.received
        line.inform(line.host, ClearStop(3 + len(tag), StopCause.OPERATOR))
        assert not line.device.firmware.latch.latched


def test_a_stop_is_no_proof_of_the_key() -> None:
    """A device accepts a stop with a wrong tag, but does not count the stop as a signed frame."""
    line = Line(KEY)
    line.begin()
    stop = Stop(901, StopCause.SESSION_END)
    payload = struct.pack("<HB", *stop)
    line.wait(20_000, encode_frame(1, STOP, 0, 0, payload + bytes(12), FLAG_AUTHENTICATED))
    line.inform(line.stranger, ClearStop(902, StopCause.SESSION_END))
    assert line.cause is StopCause.SESSION_END
