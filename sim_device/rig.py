"""A virtual sweeper behind a link with injected faults.

Its class has the methods of ``VirtualSweeper``, so it can replace a sweeper.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from protocol.can.frames import RECORD
from sim_device.faults.damage import Delay, LineDamage
from sim_device.faults.injector import FaultInjector
from sim_device.line.can_controller import CanController
from sim_device.line.device_end import DeviceEnd
from sim_device.line.line import (
    FIFO_BYTES,
    STRAIGHT,
    CanChannel,
    Channel,
    LineSettings,
    StraightChannel,
    UartDown,
    UartUp,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sim_device.body.plant import Plant, Truth
    from sim_device.faults.spec import FaultSpec
    from sim_device.rigged import RiggedDevice

_RETRY_US = 1_000
"""Time after which data that the host has not read is offered again, µs: one USB frame."""
WITHOUT_BUS: Mapping[str, str] = MappingProxyType(
    {"can-bus-off": "the device is not on a CAN bus; use emulate --link slcan"}
)
"""Kinds of fault that a device on a serial link rejects, each with the reason."""
_SEED = 0x11E
"""Constant that is combined with the seed, so that link and device have different random
sequences."""


@dataclass(slots=True)
class LineCounts:
    """Numbers of transferred, lost and changed bytes since power-on of the device."""

    to_host: int = 0
    """Number of bytes passed to the host's port."""
    from_host: int = 0
    device_overrun: int = 0
    """Number of bytes lost in the device, because it had more data than the link can transfer."""
    adapter_overrun: int = 0
    """Number of bytes lost in the adapter, because the host did not read."""
    harmed: int = 0
    """Number of bytes (on a CAN bus: frames) that faults have lost, changed or added."""
    unplugged: int = 0
    """Number of bytes lost while unplugged."""


class Rig:
    """Device, link and faults, with the methods of :class:`sim_device.sweeper.VirtualSweeper`.

    The result is deterministic for a seed, faults and times of input.
    """

    def __init__(
        self,
        device: RiggedDevice,
        settings: LineSettings = STRAIGHT,
        faults: Iterable[FaultSpec] = (),
        *,
        seed: int = 0,
    ) -> None:
        """Connect ``device`` to a link with ``settings``.

        Raises:
            FaultSpecError: a fault is impossible on this device.

        """
        self.device = device
        self.settings = settings
        cannot = device.cannot
        if not settings.bitrate:
            cannot = {**cannot, **WITHOUT_BUS}
        self.faults = FaultInjector(device, faults, cannot=cannot)
        up, down, up_delay, down_delay = np.random.default_rng((_SEED, seed)).spawn(4)
        self._damage_up, self._damage_down = LineDamage(up), LineDamage(down)
        self._delay_up, self._delay_down = Delay(up_delay), Delay(down_delay)
        self._controller = CanController() if settings.bitrate else None
        self._up, self._down = _channels(
            settings, self._damage_up, self._damage_down, self._controller
        )
        device.attach_line(DeviceEnd(self._up, self._controller))
        self._counts = LineCounts()
        self._held = b""
        self._offer_us = 0
        self.host_heard = False
        """True after a host has sent data."""

    # ---- interface of a sweeper --------------------------------------------------------------

    def step(self, data: bytes, now_us: int) -> bytes:
        """Advance to ``now_us``, then send ``data``; return the bytes that reached the host."""
        out = self._live(now_us)
        if data:
            self.host_heard = True
            self._counts.from_host += len(data)
            if self.faults.knobs.unplugged:
                self._counts.unplugged += len(data)
            elif self._delay_down.idle:
                self._down.push(data, now_us)
            else:
                self._delay_down.push(data, now_us)
            out += self._live(now_us)
        if self._held:
            out, self._held = self._held + out, b""
            if now_us < self._offer_us:
                self._hold(out)
                return b""
        self._counts.to_host += len(out)
        return out

    def next_deadline_us(self) -> int:
        """Return the time of the next step if the host sends nothing."""
        deadline_us = self._inner_deadline_us()
        return min(deadline_us, self._offer_us) if self._held else deadline_us

    @property
    def truth(self) -> Truth:
        """Return the true state at the end of the running control period."""
        return self.device.truth

    @property
    def plant(self) -> Plant:
        """The device's plant."""
        return self.device.plant

    # ---- interface of the port's owner ---------------------------------------------------------

    @property
    def plugged(self) -> bool:
        """True if the port exists, so that a host can open it."""
        return not self.faults.knobs.unplugged

    def room(self) -> int:
        """Return the number of bytes that the adapter accepts from the host now.

        With a real USB adapter, the host would have to wait before it sends more bytes.
        """
        return max(0, self._down.room())

    def take_back(self, data: bytes, now_us: int) -> None:
        """Put data that the host has not read back into the adapter's buffer.

        Data that does not fit is lost.
        """
        if not data:
            return
        self._counts.to_host -= len(data)
        self._hold(data + self._held)
        self._offer_us = now_us + _RETRY_US

    def counts(self) -> LineCounts:
        """Return the byte counts of the link."""
        counts = self._counts
        counts.device_overrun = self._up.overrun
        counts.harmed = self._damage_up.harmed + self._damage_down.harmed
        return counts

    # ---- implementation -----------------------------------------------------------------------

    def _hold(self, data: bytes) -> None:
        unit = RECORD.size if self.settings.bitrate else 1
        kept = min(len(data), FIFO_BYTES) // unit * unit
        self._counts.adapter_overrun += len(data) - kept
        self._held = data[:kept]

    def _inner_deadline_us(self) -> int:
        deadline_us = self.device.next_deadline_us()
        for source in (self.faults, self._delay_down, self._down, self._up, self._delay_up):
            due_us = source.next_us()
            if due_us is not None and due_us < deadline_us:
                deadline_us = due_us
        return deadline_us

    def _live(self, now_us: int) -> bytes:
        out = b""
        while (at_us := self._inner_deadline_us()) <= now_us:
            out += self._turn(at_us)
        self.faults.lived(now_us)
        return out

    def _turn(self, now_us: int) -> bytes:
        due_us = self.faults.next_us()
        if due_us is not None and due_us <= now_us:
            self._speak(now_us, b"")  # advance to now with the state before the change
            if self.faults.run(now_us):
                self._turn_knobs()
        if self._delay_down.next_us() is not None:
            late = self._delay_down.pull(now_us)
            if late:
                self._down.push(late, now_us)
        self._speak(now_us, self._down.pull(now_us))
        arrived = self._up.pull(now_us)
        if not self._delay_up.idle:
            if arrived:
                self._delay_up.push(arrived, now_us)
            arrived = self._delay_up.pull(now_us)
        if arrived and self.faults.knobs.unplugged:
            self._counts.unplugged += len(arrived)
            return b""
        return arrived

    def _speak(self, now_us: int, data: bytes) -> None:
        said = self.device.step(data, now_us)
        if said:
            self._up.push(said, now_us)

    def _turn_knobs(self) -> None:
        knobs = self.faults.knobs
        self._damage_up.turn(knobs.up)
        self._damage_down.turn(knobs.down)
        self._delay_up.turn(knobs.up)
        self._delay_down.turn(knobs.down)
        controller = self._controller
        if controller is not None and knobs.bus_off is not controller.is_off:
            if knobs.bus_off:
                controller.leave()
            else:
                controller.rejoin()
        if knobs.unplugged:
            self._counts.unplugged += len(self._held)
            self._held = b""
            self._down.clear()
            self._delay_down.clear()
            self._delay_up.clear()


def _channels(
    settings: LineSettings, up: LineDamage, down: LineDamage, controller: CanController | None
) -> tuple[Channel, Channel]:
    """Return the channels from device to host, and from host to device."""
    if settings.bitrate:
        latency_us = settings.latency_us
        return (
            CanChannel(settings.bitrate, latency_us, up.frame, sends=controller),
            CanChannel(settings.bitrate, 0, down.frame, receives=controller),
        )
    if settings.baud == 0:
        return StraightChannel(up.stretch), StraightChannel(down.stretch)
    return (
        UartUp(settings.baud, settings.latency_us, up.stretch),
        UartDown(settings.baud, down.stretch),
    )
