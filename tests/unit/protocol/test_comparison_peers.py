"""A real host with a virtual device that is older or newer, connected by a simulated wire."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import pytest

from bridge.session.states import CommandEnded, Data, SessionReady, State
from protocol.link import Rejected
from protocol.messages.device import Encoders, LinkCounters, Power, Range
from protocol.messages.host import ClearStop, SaveParameters, SetMode, SetParameter, SetStreamRate
from protocol.messages.values import Mode, NackReason, ParameterKind, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.fields import U8, U16, number
from protocol.schema.message import Direction, Message, RateClass, message
from support.ends import Ends, SessionEnd, session_end, sweeper
from support.peers import EXTRA, catalogue, hints_of, longer, shorter, variant

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.schema.catalogue import Catalogue

LongerPower = longer(Power, "fan")
LongerMode = longer(SetMode, "ramp")
CoarseRange = variant(
    Range,
    {
        **hints_of(Range),
        "ultrasonic": Annotated[int, number(U16, "m", "front", scale="0.01", none=65535)],
    },
)
OtherSet = variant(
    SetParameter, {**hints_of(SetParameter), "kind": Annotated[int, number(U8, "id", "other")]}
)


@message(0x5F, Direction.DEVICE, RateClass.STREAM, default_hz=5)
class Fan(Message):
    """A stream of a later version."""

    speed: EXTRA


class Pair:
    """A host and a device of given versions, after schema negotiation."""

    def __init__(self, device: Catalogue = CATALOGUE, host: Catalogue = CATALOGUE) -> None:
        self.host: SessionEnd = session_end(catalogue=host)
        self.catalogue = host
        self.ends = Ends(self.host, sweeper(catalogue=device))
        assert self.ends.run(3.0, lambda: self.host.session.state is State.READY)
        self.report = [d.report() for d in self.host.of(SessionReady)[-1].differences]

    def latest(self, name: str) -> dict[str, object]:
        """Return the field values of the last message of this name, as the host reads it."""
        data = [d.received for d in self.host.of(Data) if d.received.spec.name == name][-1]
        fields = [f.name for f in data.spec.fields]
        return dict(zip(fields, data.message, strict=True))

    def count(self, name: str) -> int:
        return sum(d.received.spec.name == name for d in self.host.of(Data))

    def ask(self, make: Callable[[int], Message]) -> NackReason | None:
        session = self.host.session
        type_id = self.catalogue.by_class[type(make(0))].type_id
        before = len(self.host.of(CommandEnded))
        session.commands.issue(make, type_id, self.ends.host_ns // 1000)
        assert self.ends.run(2.0, lambda: len(self.host.of(CommandEnded)) > before)
        outcome = self.host.of(CommandEnded)[-1].outcome
        assert outcome.accepted or outcome.reason is not None, "the device did not answer"
        return None if outcome.reason is None else NackReason(outcome.reason)


# ---- a newer device -------------------------------------------------------------------------


def test_a_newer_device_is_read_as_far_as_the_host_has_its_schema() -> None:
    pair = Pair(device=catalogue(more=[LongerPower, Fan]))
    assert pair.report == ["power: the device sends 1 more field(s), which are ignored"]
    pair.ends.run(1.1)
    power = pair.latest("power")
    assert list(power) == ["battery", "logic", "motor_left", "motor_right"]
    assert 15_000 < int(str(power["battery"])) <= 17_000
    assert pair.host.session.link.codec.extra_bytes == 2 * pair.count("power") > 0
    assert {e.reason for e in pair.host.of(Rejected)} == {"type"}, (
        "frames of the fan are only counted"
    )


def test_a_newer_device_obeys_commands_that_lack_its_last_field() -> None:
    pair = Pair(device=catalogue(more=[LongerMode]))
    assert pair.report == ["set_mode: the device declares 1 more field(s), which are not sent"]
    assert pair.ask(lambda i: ClearStop(i, StopCause.SESSION_END)) is None
    assert pair.ask(lambda i: SetMode(i, Mode.VELOCITY)) is None
    assert pair.ends.device.firmware.mode is Mode.VELOCITY


def test_the_next_host_may_send_fields_that_the_last_left_out() -> None:
    """A device keeps a host's version of a command only until the host's session ends."""
    device = catalogue(more=[LongerMode])
    pair = Pair(device=device)
    second = session_end(catalogue=device)
    pair.ends.restart_host(second)
    pair.host, pair.catalogue = second, device
    assert pair.ends.run(4.0, lambda: second.session.state is State.READY)
    assert second.of(SessionReady)[-1].differences == ()
    codec = pair.ends.device.firmware.link.codec
    assert codec.shared_fields(device.by_name["set_mode"]) == 3


# ---- an older device ------------------------------------------------------------------------


def test_an_older_devices_missing_fields_are_absent_and_never_zero() -> None:
    pair = Pair(device=catalogue(more=[shorter(Power, 2)]))
    assert pair.report == ["power: the device lacks motor_left, motor_right"]
    pair.ends.run(1.0)
    power = pair.latest("power")
    assert power["motor_left"] is power["motor_right"] is None
    assert 190 <= int(str(power["logic"])) <= 210
    message = [d.received.message for d in pair.host.of(Data) if d.received.spec.cls is Power][-1]
    assert isinstance(message, Power)
    assert message.logic_v == pytest.approx(5.0, abs=0.2)


def test_an_older_device_gets_only_the_fields_of_its_schema() -> None:
    pair = Pair(host=catalogue(more=[LongerMode]))
    assert pair.report == ["set_mode: the device lacks ramp"]
    assert pair.ask(lambda i: ClearStop(i, StopCause.SESSION_END)) is None
    longer_mode: Callable[..., Message] = LongerMode
    assert pair.ask(lambda i: longer_mode(i, Mode.VELOCITY, 9)) is None
    assert pair.ends.device.firmware.mode is Mode.VELOCITY
    _, payload = pair.host.session.link.codec.encode(longer_mode(1, Mode.VELOCITY, 9))
    assert payload.hex() == "010001"


def test_messages_that_an_older_device_does_not_have_are_named_and_never_sent() -> None:
    pair = Pair(device=catalogue(less=[LinkCounters, SetStreamRate]))
    assert pair.report == [
        "set_stream_rate: the device does not have it; disabled",
        "link_counters: the device does not have it; disabled",
    ]
    received = pair.ends.device.firmware.link.statistics
    before = received.rejected
    assert not pair.host.session.link.send(SetStreamRate(1, 0x13, 0), 0, node=1)
    pair.ends.run(2.0)
    assert received.rejected == before
    assert pair.count("link_counters") == 0
    assert pair.count("encoders") > 80


# ---- a device that declares other fields ---------------------------------------------------


def test_a_changed_field_disables_its_message_and_nothing_else() -> None:
    pair = Pair(device=catalogue(more=[CoarseRange, OtherSet]))
    assert pair.report == [
        "range: the device declares other fields; disabled",
        "set_parameter: the device declares other fields; disabled",
    ]
    pair.ends.run(1.0)
    assert pair.count("range") == 0, "the host would scale these values wrongly"
    assert {e.reason for e in pair.host.of(Rejected)} == {"disabled"}
    assert not pair.host.session.link.send(SetParameter(1, 4, ParameterKind.F32, 0), 0, node=1)
    assert pair.ask(SaveParameters) is None
    assert pair.count("encoders") > 40


def test_a_changed_field_before_an_appended_one_is_still_a_change() -> None:
    units = Annotated[int, number(U16, "raw", "left wheel")]
    changed = variant(Encoders, {"left": units, "right": EXTRA, "extra": EXTRA})
    assert Pair(device=catalogue(more=[changed])).report == [
        "encoders: the device declares other fields; disabled"
    ]


def test_everything_at_once() -> None:
    device = catalogue(less=[LinkCounters], more=[LongerPower, LongerMode, CoarseRange, Fan])
    assert Pair(device=device).report == [
        "set_mode: the device declares 1 more field(s), which are not sent",
        "range: the device declares other fields; disabled",
        "power: the device sends 1 more field(s), which are ignored",
        "link_counters: the device does not have it; disabled",
    ]
