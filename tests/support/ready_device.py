"""A device, and a session that has completed the handshake with it and sends commands."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from bridge.motion.robot_model import RobotModel
from bridge.session.states import CommandEnded, Data, SessionReady, State
from protocol.messages.device import ParameterValue
from protocol.messages.host import (
    ClearStop,
    GetParameter,
    Reboot,
    SaveParameters,
    SetMode,
    SetParameter,
    SetStreamRate,
    VelocitySetpoint,
)
from protocol.messages.values import (
    Mode,
    NackReason,
    ParameterKind,
    RebootKind,
)
from protocol.schema.catalogue import CATALOGUE
from sim_device.device.parameters import table
from support.ends import Ends, session_end, sweeper

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.schema.message import Message

F32, U32 = ParameterKind.F32, ParameterKind.U32
NUMBERS = {p.name: i for i, p in enumerate(table(RobotModel(), 1))}


def f32(value: float) -> int:
    raw: int = struct.unpack("<I", struct.pack("<f", value))[0]
    return raw


class ReadyDevice:
    """A session after the handshake with a device; it sends commands and waits for the answers."""

    def __init__(self, seed: int = 1) -> None:
        self.host = session_end()
        self.ends = Ends(self.host, sweeper(seed=seed))
        self.complete_handshake()
        self.counter = 0

    def complete_handshake(self) -> None:
        assert self.ends.run(4.0, lambda: self.host.session.state is State.READY)

    def ask(self, make: Callable[[int], Message]) -> NackReason | None:
        """Send a command until an answer arrives; return the reason of a rejection, or None."""
        session = self.host.session
        type_id = CATALOGUE.by_class[type(make(0))].type_id
        before = len(self.host.of(CommandEnded))
        session.commands.issue(make, type_id, self.ends.host_ns // 1000)
        assert self.ends.run(2.0, lambda: len(self.host.of(CommandEnded)) > before)
        outcome = self.host.of(CommandEnded)[-1].outcome
        assert not outcome.timed_out
        return None if outcome.reason is None else NackReason(outcome.reason)

    def spare_id(self) -> int:
        """Return an unused command id of the session, for a command that the test sends itself."""
        given: list[int] = []

        def make(command_id: int) -> Message:
            given.append(command_id)
            return GetParameter(command_id, 0)

        self.ask(make)
        return given[-1]

    def received(self, kind: type[Message]) -> list[Message]:
        return [d.received.message for d in self.host.of(Data) if d.received.spec.cls is kind]

    def get(self, name: str) -> ParameterValue:
        assert self.ask(lambda i: GetParameter(i, NUMBERS[name])) is None
        value = self.received(ParameterValue)[-1]
        assert isinstance(value, ParameterValue)
        assert value.parameter == NUMBERS[name]
        return value

    def set(self, name: str, value: float, kind: int = F32) -> NackReason | None:
        raw = f32(value) if kind == F32 else int(value)
        return self.ask(lambda i: SetParameter(i, NUMBERS[name], kind, raw))

    def save(self) -> NackReason | None:
        return self.ask(SaveParameters)

    def reboot(self, kind: int = RebootKind.NORMAL) -> NackReason | None:
        reason = self.ask(lambda i: Reboot(i, kind))
        if reason is None:
            known = len(self.host.of(SessionReady))
            assert self.ends.run(4.0, lambda: len(self.host.of(SessionReady)) > known)
        return reason

    def rate(self, type_id: int, tenths: int) -> NackReason | None:
        return self.ask(lambda i: SetStreamRate(i, type_id, tenths))

    def count(self, kind: type[Message], duration_s: float) -> int:
        before = len(self.received(kind))
        self.ends.run(duration_s)
        return len(self.received(kind)) - before

    def free(self, mode: Mode = Mode.VELOCITY) -> None:
        cause = self.ends.device.firmware.latch.cause
        assert self.ask(lambda i: ClearStop(i, cause)) is None
        assert self.ask(lambda i: SetMode(i, mode)) is None

    def drive(self, duration_s: float, make: Callable[[int], Message]) -> None:
        """Send a cyclic message repeatedly at 50 Hz."""
        for _ in range(round(duration_s * 50)):
            self.counter = (self.counter + 1) & 0xFF
            self.send(make(self.counter))
            self.ends.run(0.02)

    def send(self, message: Message, *, stamp_ns: int | None = None) -> None:
        """Send any message with any age, without the session's checks."""
        at_ns = self.ends.host_ns if stamp_ns is None else stamp_ns
        self.host.session.link.send(message, at_ns // 1000, node=1)
        self.ends.to_device.push(self.host.session.data_to_send(), self.ends.now_us)

    @property
    def speed(self) -> float:
        return abs(self.ends.device.truth.v_m_s)


def cruise(counter: int) -> VelocitySetpoint:
    return VelocitySetpoint(3000, 0, 200, counter)
