"""Schedule of the streams."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from protocol.messages.values import Capability
from protocol.schema.message import Direction, RateClass

if TYPE_CHECKING:
    from protocol.schema.catalogue import Catalogue
    from protocol.schema.message import MessageSpec

TICK_HZ = 100
"""Rate of the control loop, Hz; also the maximum rate of a stream."""
_NEEDS = {"planner_state": Capability.ONBOARD_PLANNER}
_CYCLE_MAX = 2_000
"""Maximum cycle length of a schedule that is stored as a table, control ticks."""


class Rate(NamedTuple):
    """Period and phase of a stream in control ticks; period 0: off."""

    name: str
    period: int
    phase: int


class Schedule:
    """Schedule of the streams in control ticks; phases are spread to avoid bursts."""

    def __init__(self, catalogue: Catalogue, capabilities: int) -> None:
        """Schedule the device's streams that its hardware supports, at their default rates."""
        self._streams: dict[int, MessageSpec] = {}
        self._phases: dict[int, int] = {}
        for index, spec in enumerate(s for s in catalogue if is_device_stream(s)):
            needed = _NEEDS.get(spec.name)
            if needed is None or needed & capabilities:
                self._streams[spec.type_id] = spec
                self._phases[spec.type_id] = index
        self._rates: dict[int, Rate] = {}
        self._on: tuple[Rate, ...] = ()
        self._table: tuple[tuple[str, ...], ...] = ()
        self.reset()

    def reset(self) -> None:
        """Restore the default rates."""
        self._rates = {
            t: self._rate(t, max(1, round(TICK_HZ / s.default_hz)))
            for t, s in self._streams.items()
        }
        self._plan()

    def set_rate(self, type_id: int, rate: int) -> None:
        """Send a stream at ``rate`` tenths of a hertz, rounded to whole ticks; 0: off."""
        period = max(1, round(10 * TICK_HZ / rate)) if rate else 0
        self._rates[type_id] = self._rate(type_id, period)
        self._plan()

    def _rate(self, type_id: int, period: int) -> Rate:
        phase = self._phases[type_id]
        return Rate(self._streams[type_id].name, period, phase % period if period else 0)

    def _plan(self) -> None:
        """Compute every tick of a whole cycle in advance, if the cycle is short."""
        self._on = tuple(r for r in self._rates.values() if r.period)
        cycle = math.lcm(1, *(r.period for r in self._on))
        ticks = cycle if cycle <= _CYCLE_MAX else 0
        self._table = tuple(self._due(tick) for tick in range(ticks))

    def default_phase(self, name: str, period: int) -> int:
        """Return the phase of a stream at a period, ticks; 0 if the stream is not declared."""
        phases = (p for t, p in self._phases.items() if self._streams[t].name == name)
        return next(phases, 0) % period

    def __contains__(self, type_id: int) -> bool:
        """Return whether the device can send this stream."""
        return type_id in self._streams

    def due(self, tick: int) -> tuple[str, ...]:
        """Return the names of the streams to send at this tick."""
        table = self._table
        return table[tick % len(table)] if table else self._due(tick)

    def _due(self, tick: int) -> tuple[str, ...]:
        return tuple(name for name, period, phase in self._on if tick % period == phase)


def is_device_stream(spec: MessageSpec) -> bool:
    """Return whether a device sends this message periodically."""
    return spec.direction is Direction.DEVICE and spec.rate is RateClass.STREAM
