"""Telemetry of the firmware: creates the message of each stream from the present readings."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import sweepctl_plugins
from protocol.messages.device import Encoders, Imu
from protocol.schema.catalogue import CATALOGUE
from sim_device.device.counters import Counters
from sim_device.device.stream_messages import StreamMessages
from sim_device.device.streams import TICK_HZ, is_device_stream
from sim_device.device.versions import as_spec, blank

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocol.link import LinkBase
    from protocol.schema.message import Message, MessageSpec
    from sim_device.device.control import Control
    from sim_device.device.sampling import Sampler

TICK_WORK_US = 400
FRAME_WORK_US = 25
"""Assumed computing time of a control period and of a frame on a 168 MHz Cortex-M4, µs. The
reported ``load`` uses it."""
LOAD_TICKS = 10
_LOAD_US = LOAD_TICKS * 1_000_000 // TICK_HZ


class Telemetry:
    """Encodes the readings of each stream, by the stream's name."""

    def __init__(self, link: LinkBase, sampler: Sampler, control: Control) -> None:
        self.counters = Counters()
        self._sampler, self._codec, self._statistics = sampler, link.codec, link.statistics
        self._frames_before = 0
        self._messages = StreamMessages(sampler, control, link.statistics, self.counters)
        self.streams = {
            spec.name: (spec.type_id, self._packer(spec))
            for spec in link.codec.catalogue
            if is_device_stream(spec)
        }
        """Type of each stream, and the function that returns its payload at an uptime (µs), by the
        stream's name."""

    def _packer(self, spec: MessageSpec) -> Callable[[int], bytes]:
        """Return the function that encodes a stream's readings as the catalogue declares."""
        sampler, codec, pack = self._sampler, self._codec, spec.layout.pack
        if spec.cls is Imu:  # a fast path: these two streams have most of the bytes
            return lambda _now_us: pack(*sampler.imu)
        if spec.cls is Encoders:
            return lambda _now_us: pack(*sampler.counts)
        maker = self._maker(spec)
        if spec.cls in CATALOGUE.by_class:
            return lambda now_us: codec.encode(maker(now_us))[1]
        return lambda now_us: codec.encode(as_spec(maker(now_us), spec))[1]

    def _maker(self, spec: MessageSpec) -> Callable[[int], Message]:
        """Return the function that creates a stream's message, in this program's own class."""
        # This version of the project does not have the stream: all fields are zero.
        blank_one = functools.partial(_blank, spec)
        simulated = getattr(spec.cls, "simulated", None)
        if simulated is not None:
            return _Simulated(spec, simulated, blank_one)
        maker: Callable[[int], Message] = getattr(self._messages, spec.name, blank_one)
        return maker

    def measure_load(self) -> None:
        """Compute the busy share of the last ten periods."""
        statistics = self._statistics
        frames = statistics.frames_in + statistics.frames_out
        work_us = LOAD_TICKS * TICK_WORK_US + (frames - self._frames_before) * FRAME_WORK_US
        self._frames_before = frames
        self.counters.load_percent = min(100, round(100 * work_us / _LOAD_US))


def _blank(spec: MessageSpec, _now_us: int) -> Message:
    return blank(spec)


class _Simulated:
    """Creates a plug-in's message by its ``simulated(now_us)``; zeros after an exception."""

    def __init__(
        self,
        spec: MessageSpec,
        simulated: Callable[[int], Message],
        blank_one: Callable[[int], Message],
    ) -> None:
        self._spec, self._simulated, self._blank = spec, simulated, blank_one
        self._broken = False

    def __call__(self, now_us: int) -> Message:
        """Return the message at an uptime in µs."""
        if self._broken:
            return self._blank(now_us)
        try:
            made = self._simulated(now_us)
            self._spec.layout.pack(*made)
        except Exception as error:  # noqa: BLE001 - a plug-in may raise anything
            self._broken = True
            where = f"{self._spec.cls.__module__}.{self._spec.cls.__name__}.simulated"
            sweepctl_plugins.disable(f"{where} raised {type(error).__name__}: {error}")
            return self._blank(now_us)
        return made
