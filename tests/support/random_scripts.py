"""Strategy that draws scripts with the actions of a host, both valid and hostile."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any
from zlib import crc32

from cobs import cobs
from hypothesis import strategies as st

from protocol.can.link import CanLink
from protocol.messages.host import (
    ClearStop,
    Describe,
    GetParameter,
    HostHello,
    PlannerCommand,
    Reboot,
    SaveParameters,
    SetMode,
    SetParameter,
    SetStreamRate,
    Stop,
    TimeRequest,
    VelocitySetpoint,
    WheelDuty,
)
from protocol.messages.values import Mode, StopCause
from protocol.schema.message import Direction
from protocol.uart.framing import encode_frame
from protocol.uart.link import Link
from support.script_format import NO_RANGE, PARAMETERS, Boot, Readings, Step

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.schema.message import Message
    from support.script_format import Act

HOST_AHEAD_US = 5_000_000
HELLO = 0x04
F32 = struct.Struct("<f")


def f32(value: float) -> int:
    """Return the 32 bits of a parameter's value."""
    return int.from_bytes(F32.pack(value), "little")


class Writer:
    """Writes a script with the messages of one host, with its sequence numbers and its clock."""

    def __init__(self, *, can: bool = False) -> None:
        self.acts: list[Act] = [Readings()]
        if can:
            self.acts.append(Boot(can=True))
        self.now_us = 0
        self._link = (CanLink if can else Link)(Direction.HOST)
        self._can = can
        self._printed: list[bytes] = []
        self.counter = 0
        self.reboots = 0
        """Number of reboots by a command or a loss of supply since the last ``Boot`` in the script.
        """

    @property
    def boot_id(self) -> int:
        """Boot id of the current boot in the script."""
        boots = [act for act in self.acts if isinstance(act, Boot)]
        return (boots or [Boot()])[-1].boot_id + self.reboots

    def wait(self, for_us: int) -> None:
        """Send nothing for a time."""
        self.now_us += for_us
        self.acts.append(Step(for_us))

    def read(self, readings: Readings) -> None:
        """Set the sensor readings from now on."""
        self.acts.append(readings)

    def inform(
        self, *messages: Message, after_us: int = 1000, age_us: int = 0, node: int = 1
    ) -> None:
        """Send messages together, with stamps that are ``age_us`` old."""
        for message in messages:
            self._link.send(message, self.now_us + after_us + HOST_AHEAD_US - age_us, node=node)
        data = self._link.data_to_send()
        self._printed.append(data)
        self.raw(data, after_us=after_us)

    def raw(self, data: bytes, after_us: int = 1000) -> None:
        """Send bytes unchanged."""
        self.now_us += after_us
        self.acts.append(Step(after_us, data))

    def replay(self, back: int) -> None:
        """Send earlier bytes again; ``back`` is 0 for the last sending, 1 for the one before."""
        if self._printed:
            self.raw(self._printed[-1 - back % len(self._printed)])

    def damage(self, bit: int) -> None:
        """Send the last bytes again with one inverted bit."""
        if self._printed and self._printed[-1]:
            data = bytearray(self._printed[-1])
            data[bit // 8 % len(data)] ^= 1 << bit % 8
            self.raw(bytes(data))

    def cut(self, kept: int) -> None:
        """Send the last bytes again without their end."""
        if self._printed and self._printed[-1]:
            self.raw(self._printed[-1][: kept % len(self._printed[-1])])

    def frame(self, node: int, type_id: int, payload: bytes, flags: int = 0) -> None:
        """Send any payload in a valid frame."""
        stamp_us = self.now_us + HOST_AHEAD_US
        self.raw(b"\0" + encode_frame(node, type_id, 0, stamp_us, payload, flags))

    def hello(self, name: bytes) -> None:
        """Send a hello whose name may be invalid UTF-8."""
        self.frame(1, HELLO, struct.pack("<IIIB", 1, 9, self.boot_id, 1) + name)

    def begin(self, session_id: int = 7) -> None:
        """Open a session after a boot and enter velocity mode."""
        self.inform(HostHello(0, session_id, self.boot_id, 0, "first"))
        self.inform(HostHello(0, session_id, self.boot_id, 1, "first"))
        self.inform(ClearStop(0xFFF0, StopCause.SESSION_END), SetMode(0xFFF1, Mode.VELOCITY))

    def drive(self, v: int, yaw_rate: int, times: int) -> None:
        """Send setpoints as a host does."""
        for _ in range(times):
            self.counter = (self.counter + 1) & 0xFF
            self.inform(VelocitySetpoint(v, yaw_rate, 200, self.counter), after_us=20_000)


def _setpoint(kind: Callable[..., Message]) -> st.SearchStrategy[Any]:
    return st.tuples(
        st.just("setpoint"),
        st.just(kind),
        st.integers(-32768, 32767) if kind is VelocitySetpoint else st.integers(-10_000, 10_000),
        st.integers(-10_000, 10_000),
        st.sampled_from([0, 1, 50, 200, 250, 255]),
        st.sampled_from([1, 1, 1, 2, 0, 127, 128, 255]),
        st.sampled_from([0, 0, 0, 100, 4_001, 199_999, 200_000, 300_000, -40_000]),
    )


_ids = st.integers(1, 6)
_causes = st.integers(0, 7)
_values = st.one_of(
    st.sampled_from([f32(x) for x in (0.0, 0.1, 0.25, 1.0, 15.0, 100.0, -1.0)]),
    st.sampled_from([f32(float("nan")), f32(float("inf")), 1560, 3, 2_000_000, 0xFFFF_FFFF]),
)
_commands: st.SearchStrategy[Message] = st.one_of(
    st.builds(ClearStop, _ids, _causes),
    st.builds(SetMode, _ids, st.integers(0, 5)),
    st.builds(SetMode, _ids, st.just(Mode.VELOCITY)),
    # Only the paper's planner, which C has; another test compares its path.
    st.builds(PlannerCommand, _ids, st.integers(1, 4), st.integers(0, 5)),
    st.builds(GetParameter, _ids, st.integers(0, PARAMETERS + 1)),
    st.builds(SetParameter, _ids, st.integers(0, PARAMETERS + 1), st.integers(0, 4), _values),
    st.builds(SetParameter, _ids, st.integers(4, 8), st.just(2), st.just(f32(0.25))),
    st.builds(SaveParameters, _ids),
    st.builds(
        SetStreamRate,
        _ids,
        st.integers(0x0F, 0x2C),
        st.sampled_from([0, 1, 16, 39, 40, 80, 333, 400, 500, 1000, 2000, 10_000, 10_001]),
    ),
    st.builds(Reboot, _ids, st.integers(0, 3)),
    st.builds(Stop, _ids, _causes),
)
_questions: st.SearchStrategy[Message] = st.one_of(
    st.builds(TimeRequest, st.integers(0, 255)),
    st.builds(Describe, st.integers(0, 0x20), st.integers(0, 12)),
    st.builds(
        HostHello,
        st.integers(0, 2**32 - 1),
        st.sampled_from([0, 7, 8]),
        st.sampled_from([0, Boot().boot_id, Boot().boot_id + 1]),
        st.sampled_from([0, 1, 2]),
        st.text(max_size=70),
    ),
)
_waits = st.sampled_from([0, 1, 999, 5_000, 10_000, 10_001, 33_333, 120_000, 260_000])
_readings = st.builds(
    Readings,
    st.tuples(st.integers(0, 40), st.integers(0, 40)),
    st.tuples(
        *[st.sampled_from([0, 30, -2600, 4000])] * 2,
        st.sampled_from([16384, 16390, 13000, 20_000, 2000]),
        st.just(0),
        *[st.sampled_from([0, 5, -3000, 32767])] * 3,
    ),
    # Differences that do not hit a threshold: a value exactly at one is a matter of rounding.
    st.sampled_from([97, 104, 300, 307, 342, 3999, NO_RANGE]),
    st.tuples(*[st.sampled_from([400, 411, 530, 2999, NO_RANGE])] * 2),
    st.integers(0, 7),
    st.sampled_from([16_000, 12_900, 12_600, 11_900, 65_535]),
    st.sampled_from([0, 5_003, 7_001]),
    st.tuples(*[st.sampled_from([3, 57, 399, 401, 1_803, 6_001])] * 2),
    st.sampled_from([0, 499, 500, 1_500, 6_100, 59_999, 254_499, 254_500, 4_000_000]),
)
_frames = st.tuples(
    st.just("frame"),
    st.integers(0, 15),
    st.integers(0, 0x7E),
    st.binary(max_size=12),
    st.integers(0, 3),
)
HOSTILE = st.one_of(
    st.tuples(st.just("replay"), st.integers(0, 20)),
    st.tuples(st.just("damage"), st.integers(0, 400)),
    st.tuples(st.just("cut"), st.integers(1, 40)),
    st.tuples(st.just("raw"), st.binary(max_size=40)),
    st.tuples(st.just("version"), st.integers(0, 15)),
    st.tuples(st.just("hello"), st.binary(max_size=20)),
    _frames,
)
FAIR = st.one_of(
    st.tuples(st.just("say"), _commands, st.just(1)),
    st.tuples(st.just("say"), st.one_of(_commands, _questions), st.sampled_from([0, 1, 1, 1, 2])),
    _setpoint(VelocitySetpoint),
    _setpoint(VelocitySetpoint),
    _setpoint(WheelDuty),
    st.tuples(st.just("drive"), st.integers(-3000, 3000), st.integers(-9000, 9000)),
    st.tuples(st.just("wait"), _waits),
    st.tuples(st.just("wait"), st.sampled_from([700_000, 1_100_000])),
)
SENSED = st.tuples(st.just("read"), _readings)


def write(deeds: list[Any], *, can: bool = False, begun: bool = True) -> list[Act]:
    """Return the script of the drawn actions."""
    writer = Writer(can=can)
    if begun:
        writer.begin()
    for kind, *rest in deeds:
        _DEEDS[kind](writer, *rest)
    writer.wait(30_000)
    return writer.acts


def _do_setpoint(  # noqa: PLR0913, PLR0917 - the fields of a setpoint
    writer: Writer,
    kind: Callable[..., Message],
    first: int,
    second: int,
    time_to_live: int,
    advance: int,
    age_us: int,
) -> None:
    writer.counter = writer.counter + advance & 0xFF
    writer.inform(kind(first, second, time_to_live, writer.counter), age_us=age_us)


def _do_version(writer: Writer, version: int) -> None:
    """Send a stop of another protocol version."""
    writer.raw(b"\0" + _sealed(bytes((version << 4, 1, 0, 0)) + bytes(4) + b"\1\0\4"))


def _sealed(body: bytes) -> bytes:
    sealed: bytes = cobs.encode(body + crc32(body).to_bytes(4, "little"))
    return sealed + b"\0"


_DEEDS: dict[str, Callable[..., None]] = {
    "say": lambda writer, message, node: writer.inform(message, node=node),
    "setpoint": _do_setpoint,
    "drive": lambda writer, v, yaw_rate: writer.drive(v, yaw_rate, 4),
    "wait": Writer.wait,
    "read": Writer.read,
    "replay": Writer.replay,
    "damage": Writer.damage,
    "cut": Writer.cut,
    "raw": Writer.raw,
    "version": _do_version,
    "hello": Writer.hello,
    "frame": Writer.frame,
}
