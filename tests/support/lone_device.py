"""A device without a host: the test sends frames and decodes the answers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocol.link import Received
from protocol.messages.host import ClearStop, HostHello, SetMode, TimeRequest, VelocitySetpoint
from protocol.messages.values import Mode, StopCause
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction, Message
from protocol.uart.link import Link
from support.ends import sweeper

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_device.device.virtual_firmware import Firmware
    from sim_device.sweeper import VirtualSweeper

SESSION = 0xABCD


class LoneDevice:
    """A device without a host: the test sends frames and decodes the answers."""

    def __init__(self, device: VirtualSweeper | None = None) -> None:
        self.device = device or sweeper()
        self.link = Link(Direction.HOST)
        self.now_us = 0
        self.received: list[tuple[int, Message]] = []
        self.counter = 0
        self._take(self.device.step(b"", 0))  # the hello of its boot

    @property
    def firmware(self) -> Firmware:
        return self.device.firmware

    @property
    def boot_id(self) -> int:
        return self.firmware.identity.boot_id

    def send(self, *messages: Message, node: int = 1, stamp_us: int | None = None) -> list[Message]:
        for message in messages:
            self.link.send(message, self.now_us if stamp_us is None else stamp_us, node=node)
        return self._take(self.device.step(self.link.data_to_send(), self.now_us))

    def run(self, duration_s: float, each: Callable[[], None] = lambda: None) -> list[Message]:
        found: list[Message] = []
        for _ in range(round(duration_s * 100)):
            self.now_us += 10_000
            found += self._take(self.device.step(b"", self.now_us))
            each()
        return found

    def _take(self, out: bytes) -> list[Message]:
        messages = [e.message for e in self.link.receive(out) if isinstance(e, Received)]
        self.received += [(self.now_us, m) for m in messages]
        return messages

    def join(self, session: int = SESSION) -> None:
        self.send(HostHello(CATALOGUE.hash, session, self.boot_id, 0, "test"))
        self.send(HostHello(CATALOGUE.hash, session, self.boot_id, 1, "test"))

    def free(self) -> None:
        self.join()
        self.send(ClearStop(1, self.firmware.latch.cause), SetMode(2, Mode.VELOCITY))
        assert self.firmware.mode is Mode.VELOCITY

    def drive(self, ttl_ms: int = 200, stamp_us: int | None = None) -> None:
        self.counter += 1
        self.send(
            VelocitySetpoint(2000, 0, ttl_ms, self.counter & 0xFF),
            stamp_us=stamp_us,
        )

    def ping(self) -> None:
        self.send(TimeRequest(1))

    def cause(self) -> StopCause:
        return self.firmware.latch.cause

    @property
    def speed(self) -> float:
        return abs(self.device.truth.v_m_s)


def kinds(messages: list[Message]) -> list[str]:
    return [type(m).__name__ for m in messages]
