"""Schema negotiation between a host and a device whose declarations of a message differ."""

from __future__ import annotations

import random
from typing import Annotated

import pytest

from bridge.run.mission import Phase
from bridge.run.robot_state import missing_needs, understood
from bridge.session.states import Data, Failed, SessionReady, State
from protocol.link import Received, Rejected
from protocol.messages import ALL_MESSAGES
from protocol.messages.device import (
    Ack,
    DescribeReply,
    Encoders,
    Hello,
    Imu,
    LinkCounters,
    Power,
    Range,
    Status,
)
from protocol.messages.host import Describe, SetMode, Stop, VelocitySetpoint
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.comparison import Match, MessageComparison
from protocol.schema.fields import U8, U16, number
from protocol.schema.message import Direction, Message, RateClass, message, specify
from protocol.uart.framing import encode_frame
from protocol.uart.link import Link
from support.ends import Ends, HostEnd, SessionEnd, Valve, session_end, spinning_host, sweeper
from support.hostile import Lossy, Piece, Pipe, Wire
from support.peers import EXTRA, catalogue, hints_of, variant

LonelyPower = variant(Power, dict(list(hints_of(Power).items())[:2]))
RicherPower = variant(Power, {**hints_of(Power), "fan": EXTRA})
OtherPower = variant(
    Power,
    {**hints_of(Power), "battery": Annotated[int, number(U16, "V", "the rail", scale="0.002")]},
)
OtherSetpoint = variant(
    VelocitySetpoint,
    {**hints_of(VelocitySetpoint), "counter": Annotated[int, number(U8, "id", "must advance")]},
)


@message(0x60, Direction.DEVICE, RateClass.RARE)
class Fan(Message):
    """A message that only one peer has."""

    speed: EXTRA


class Declaring(Wire):
    """A device with another catalogue, in which one message has fewer fields."""

    def __init__(self, type_id: int, fields: int) -> None:
        super().__init__(Pipe(1_000))
        self._type_id, self._fields = type_id, fields
        self._rest = b""

    def misbehave(self, piece: Piece) -> list[Piece]:
        *whole, self._rest = (self._rest + piece.data).split(b"\0")
        return [Piece(piece.at_us, b"".join(self._passed(frame + b"\0") for frame in whole))]

    def _passed(self, data: bytes) -> bytes:
        for event in Link(Direction.HOST).receive(data):
            if not isinstance(event, Received):
                continue
            f, printed = event.frame, event.message
            if isinstance(printed, Hello):
                other = (CATALOGUE.hash ^ 1).to_bytes(4, "little")
                return encode_frame(f.node, f.type_id, f.seq, f.t_us, other + f.payload[4:])
            if isinstance(printed, DescribeReply) and printed.described_type == self._type_id:
                chain = CATALOGUE.chains[self._type_id][self._fields]
                payload = bytes([self._type_id, self._fields, 0]) + chain.to_bytes(4, "little")
                return encode_frame(f.node, f.type_id, f.seq, f.t_us, payload)
        return data


def negotiated(host: SessionEnd, ends: Ends, within_s: float = 3.0) -> SessionReady:
    assert ends.run(within_s, lambda: host.session.state is State.READY)
    return host.of(SessionReady)[-1]


def power_of(host: SessionEnd) -> list[Message]:
    return [d.received.message for d in host.of(Data) if d.received.spec.name == "power"]


def test_equal_catalogues_ask_nothing() -> None:
    host = session_end()
    ends = Ends(host, sweeper())
    assert negotiated(host, ends).differences == ()
    assert not [s for s in ends.sent if isinstance(s.message, Describe)]


def test_an_older_device_lacks_our_last_field() -> None:
    host = session_end(catalogue=catalogue(more=[RicherPower]))
    ends = Ends(host, sweeper())
    (difference,) = negotiated(host, ends).differences
    assert difference.match is Match.OLDER
    assert difference.report() == "power: the device lacks fan"
    ends.run(1.0)
    message = power_of(host)[-1]
    assert tuple(message)[-1] is None
    assert 15_000 < next(iter(message)) <= 17_000


def test_a_newer_devices_fields_are_skipped_and_counted() -> None:
    host = session_end(catalogue=catalogue(more=[LonelyPower]))
    ends = Ends(host, sweeper())
    (difference,) = negotiated(host, ends).differences
    assert difference.match is Match.NEWER
    assert "2 more field(s)" in difference.report()
    ends.run(1.0)
    messages = power_of(host)
    assert len(messages) >= 4
    assert all(len(tuple(m)) == 2 for m in messages)
    assert host.session.link.codec.extra_bytes == 2 * len(messages)


def test_a_different_declaration_is_disabled_and_named() -> None:
    host = session_end(catalogue=catalogue(more=[OtherPower]))
    ends = Ends(host, sweeper())
    (difference,) = negotiated(host, ends).differences
    assert difference.match is Match.DIFFERENT
    assert difference.report() == "power: the device declares other fields; disabled"
    ends.run(1.0)
    assert power_of(host) == []
    assert {e.reason for e in host.of(Rejected)} == {"disabled"}


def test_a_message_that_the_device_does_not_have() -> None:
    host = session_end(catalogue=catalogue(more=[Fan]))
    ends = Ends(host, sweeper())
    (difference,) = negotiated(host, ends).differences
    assert difference.match is Match.MISSING
    assert difference.report() == "fan: the device does not have it; disabled"


def test_a_message_that_only_the_device_has_is_ignored() -> None:
    host = session_end(catalogue=catalogue(less=[LinkCounters]))
    ends = Ends(host, sweeper())
    assert negotiated(host, ends).differences == ()
    ends.run(1.5)
    assert {e.reason for e in host.of(Rejected)} == {"type"}


def test_a_device_that_cannot_be_asked_is_given_up() -> None:
    host = session_end()
    ends = Ends(host, sweeper(catalogue=catalogue(less=[Describe])))
    ends.run(9.0)
    assert [e.kind for e in host.of(Failed)] == ["transmit_only"]


def test_a_different_bootstrap_message_fails_with_a_name() -> None:
    changed = variant(
        SetMode, {"command_id": Annotated[int, number(U8, "id", "shorter")]}
    )  # not a bootstrap message: only this message is disabled
    host = session_end()
    ends = Ends(host, sweeper(catalogue=catalogue(more=[changed])))
    assert [d.report() for d in negotiated(host, ends).differences] == [
        "set_mode: the device declares other fields; disabled"
    ]
    stop = next(m for m in ALL_MESSAGES if m.__name__ == "Stop")
    bad = variant(stop, {"command_id": Annotated[int, number(U8, "id", "shorter")]})
    host = session_end()
    ends = Ends(host, sweeper(catalogue=catalogue(more=[bad])))
    assert ends.run(3.0, lambda: host.session.state is State.FAILED)
    (failed,) = host.of(Failed)
    assert failed.kind == "incompatible"
    assert "stop" in failed.text


@pytest.mark.parametrize(("of", "fields"), [(Stop, 0), (Stop, 1), (Ack, 1), (Hello, 4)])
def test_a_bootstrap_message_that_lacks_fields_fails_too(of: type[Message], fields: int) -> None:
    """A device whose stop lacks its cause, or whose ack lacks its type, is not compatible."""
    host = session_end()
    ends = Ends(host, sweeper())
    ends.to_host = Valve(Declaring(specify(of).type_id, fields))
    assert ends.run(3.0, lambda: host.session.state is State.FAILED), host.session.state
    (failed,) = host.of(Failed)
    assert failed.kind == "incompatible"
    assert f"{specify(of).name}: the device lacks" in failed.text


@pytest.mark.parametrize("p", [0.0, 0.3])
def test_negotiation_costs_a_question_a_message(p: float) -> None:
    """In an earlier version, each reply caused four requests, which caused four more replies."""

    def lossy() -> Wire:
        return Lossy(Pipe(3_000), p, random.Random(5))

    host = session_end(catalogue=catalogue(more=[Fan]))
    ends = Ends(host, sweeper(), to_device=lossy(), to_host=lossy())
    negotiated(host, ends, within_s=9.0)
    questions = [s for s in ends.sent if isinstance(s.message, Describe)]
    assert len(questions) <= (2 if p == 0.0 else 8) * len(CATALOGUE.specs)


def test_a_reflashed_device_needs_a_new_negotiation() -> None:
    ours = catalogue(more=[OtherSetpoint])
    host = session_end(catalogue=ours)
    ends = Ends(host, sweeper())
    negotiated(host, ends)
    assert host.session.link.disabled
    ends.device.catalogue = ours
    ends.reboot_device(5)
    assert ends.run(3.0, lambda: len(host.of(SessionReady)) == 2)
    assert host.of(SessionReady)[-1].differences == ()
    assert not host.session.link.disabled


def test_a_device_without_our_setpoint_is_not_driven() -> None:
    host = HostEnd(spinning_host())
    ends = Ends(host, sweeper(catalogue=catalogue(more=[OtherSetpoint])))
    mission = host.host.mission
    assert ends.run(5.0, lambda: mission.done)
    assert mission.ending is not None
    assert mission.ending.exit_status == 4
    assert "velocity_setpoint" in mission.ending.reason
    assert mission.phase is Phase.DONE
    assert ends.moving_us < 0


def test_requirements_of_driving() -> None:
    def differ(cls: type[Message], match: Match, fields: int) -> MessageComparison:
        return MessageComparison(specify(cls), match, fields)

    assert missing_needs([differ(Power, Match.DIFFERENT, 4)]) == []
    assert missing_needs([differ(Imu, Match.OLDER, 6)]) == ["imu"]
    assert missing_needs([differ(Imu, Match.NEWER, 9)]) == []
    assert missing_needs([differ(Range, Match.MISSING, 0)]) == ["range"]
    assert missing_needs([differ(SetMode, Match.DIFFERENT, 2)]) == ["set_mode"]


def test_a_message_is_looked_into_only_where_it_is_whole() -> None:
    assert understood(Encoders(1, 2))
    assert not understood(Encoders(1, None))  # type: ignore[arg-type]  # as an older peer sends it
    assert understood(Status(0, 0, 0, None, None))  # type: ignore[arg-type]  # unused
    assert not understood(Status(0, 0, None, None, None))  # type: ignore[arg-type]  # one is used
    assert understood(LinkCounters(*[None] * 8))  # type: ignore[arg-type]  # recorded, not used
