"""A simulated connection between a bring-up session and an emulated device, in virtual time.

The module also has a scripted person, who does what the session requests.
"""

from __future__ import annotations

import itertools
from collections import deque
from typing import TYPE_CHECKING

from bridge.bringup.session import BringupSession
from protocol.clock import HostNs
from sim_device.line.line import STRAIGHT
from sim_device.rig import Rig

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bridge.bringup.wiring import CheckResult
    from protocol.link import LinkBase
    from sim_device.sweeper import VirtualSweeper

BOOT_NS = 7_000_000_000
LATENCY_US = 1_000
CALM_S = 1.0


class RigWire:
    """Host and device on one clock: sent bytes arrive ``LATENCY_US`` later."""

    def __init__(self, device: VirtualSweeper) -> None:
        self.device = device
        self.rig = Rig(device, STRAIGHT)
        self.now_us = 0
        self.closed = False
        self.latency_us = LATENCY_US
        """Latency each way of the bytes sent from now on, µs."""
        self._down: deque[tuple[int, bytes]] = deque()
        self._up: deque[tuple[int, bytes]] = deque()

    @property
    def link(self) -> type[LinkBase]:
        return self.device.link

    def now(self) -> HostNs:
        return HostNs(self.now_us * 1000 + BOOT_NS)

    def turn(self, data: bytes, until_ns: HostNs) -> bytes:
        if data:
            self._down.append((self.now_us + self.latency_us, data))
        until_us = max(self.now_us, -((BOOT_NS - until_ns) // 1000))
        while True:
            moments = [until_us, self.rig.next_deadline_us()]
            moments += [queue[0][0] for queue in (self._down, self._up) if queue]
            self.now_us = max(self.now_us, min(moments))
            arrived = b""
            while self._down and self._down[0][0] <= self.now_us:
                arrived += self._down.popleft()[1]
            printed = self.rig.step(arrived, self.now_us)
            if printed:
                self._up.append((self.now_us + self.latency_us, printed))
            received = b""
            while self._up and self._up[0][0] <= self.now_us:
                received += self._up.popleft()[1]
            if received or self.now_us >= until_us:
                return received

    def close(self) -> None:
        self.closed = True


def bringup_session(
    device: VirtualSweeper, key: bytes | None = None
) -> tuple[BringupSession, RigWire]:
    """Return a session that is ready with an emulated device."""
    wire = RigWire(device)
    ids = itertools.count(0x5EED_1000)
    return BringupSession(wire, lambda: next(ids), key=key), wire


class Scripted:
    """A person who follows a script when asked."""

    def __init__(
        self,
        *,
        confirm: Callable[[str], bool] = lambda _text: True,
        choose: Callable[[str], str] = lambda _text: "n",
        number: Callable[[str], float] = lambda _text: 0.0,
    ) -> None:
        self.reported: list[str] = []
        self.asked: list[str] = []
        self._confirm, self._choose, self._number = confirm, choose, number

    def show(self, text: str) -> None:
        self.reported.append(text)

    def report(self, finding: CheckResult) -> None:
        self.reported.append(finding.line)

    def confirm(self, text: str) -> bool:
        self.asked.append(text)
        return self._confirm(text)

    def choose(self, text: str, answers: Mapping[str, str]) -> str:
        self.asked.append(text)
        printed = self._choose(text)
        assert printed in answers
        return printed

    def number(self, text: str) -> float:
        self.asked.append(text)
        return self._number(text)
