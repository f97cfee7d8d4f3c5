"""The real-time loop, which runs the device in real time and measures its own lateness."""

from __future__ import annotations

import math
import select
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from sim_device.rig import Rig

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_device.body.plant import Truth
    from sim_device.faults.injector import FaultEvent
    from sim_device.ports.base import DevicePort, Stopper
    from sim_device.ports.control import ControlServer
    from sim_device.rigged import RiggedDevice

_STEPS = 8
"""Number of histogram bins per doubling of the lateness. Percentiles have a resolution of 9 %."""
_BINS = 28 * _STEPS
"""Number of histogram bins; the last bin is at four minutes."""


@dataclass(slots=True)
class Lateness:
    """Distribution of the lateness of control periods, in constant memory."""

    periods: int = 0
    worst_us: int = 0
    _bins: list[int] = field(default_factory=lambda: [0] * _BINS)

    def add(self, late_us: int) -> None:
        """Count one period."""
        self.periods += 1
        self.worst_us = max(self.worst_us, late_us)
        place = int(_STEPS * math.log2(late_us)) + 1 if late_us > 0 else 0
        self._bins[min(place, _BINS - 1)] += 1

    def percentile_us(self, percent: float) -> int:
        """Return a percentile of the lateness, µs."""
        wanted = math.ceil(self.periods * percent / 100.0)
        seen = 0
        for place, count in enumerate(self._bins):
            seen += count
            if seen >= wanted:
                return min(self.worst_us, math.ceil(2 ** (place / _STEPS)))
        return self.worst_us


@dataclass(slots=True)
class ServeReport:
    """Statistics of a served run."""

    lateness: Lateness
    duration_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeCallbacks:
    """Callbacks during a served run; times are Unix times in nanoseconds."""

    on_truth: Callable[[Truth, int], None] | None = None
    """Called after every control period with the true state and its time."""
    on_fault: Callable[[FaultEvent, int], None] | None = None
    """Called at each start and end of a fault."""
    on_plug: Callable[[str | None], None] | None = None
    """Called with the port's name when the port appears, and with None when it disappears."""


NO_CALLBACKS = ServeCallbacks()


class SelfTimed(Protocol):
    """A device that needs the loop at its own times, because its chip is another process."""

    def filenos(self) -> list[int]:
        """File descriptors that become readable when the device has work."""

    def poll(self, now_us: int) -> None:
        """Record that the device has work, so that the loop steps it at ``now_us``."""


def serve(  # noqa: PLR0913 - participants of a run
    device: RiggedDevice | Rig,
    port: DevicePort,
    stopper: Stopper,
    callbacks: ServeCallbacks = NO_CALLBACKS,
    control: ControlServer | None = None,
    *,
    waker: SelfTimed | None = None,
) -> ServeReport:
    """Run the device in real time on a port until stopped.

    ``waker`` is the device itself, if it is a :class:`SelfTimed`.

    Raises:
        PortUnavailableError: a port cannot be created again after it was unplugged.

    """
    rig = device if isinstance(device, Rig) else Rig(device)
    served = _Served(rig, port, callbacks, control, waker)
    while not stopper.stopped:
        served.turn(stopper)
    return served.report()


class _Served:
    """One served device on one port; :meth:`turn` is one loop iteration."""

    def __init__(
        self,
        rig: Rig,
        port: DevicePort,
        callbacks: ServeCallbacks,
        control: ControlServer | None,
        waker: SelfTimed | None,
    ) -> None:
        self._rig, self._port, self._callbacks, self._control = rig, port, callbacks, control
        self._waker = waker
        self._lateness = Lateness()
        self._start_ns = time.monotonic_ns()
        self._unix_at_boot_ns = time.time_ns()
        self._last_tick = -1
        self._plugged = True

    def turn(self, stopper: Stopper) -> None:
        """Wait for bytes, a request or the deadline; advance the device; write its bytes."""
        rig, port = self._rig, self._port
        wait_s = max(0.0, (rig.next_deadline_us() - self._now_us()) / 1e6)
        room = rig.room()
        listened = port.filenos() if room else []
        asked = self._control.filenos() if self._control is not None else []
        awake = self._waker.filenos() if self._waker is not None else []
        ready, _, _ = select.select([stopper.fileno(), *listened, *asked, *awake], [], [], wait_s)
        if self._waker is not None and not set(awake).isdisjoint(ready):
            self._waker.poll(self._now_us())
        data = port.read(room) if not set(listened).isdisjoint(ready) else b""
        port.tend()
        now_us = self._now_us()
        late_us = now_us - rig.device.next_deadline_us()
        if late_us >= 0:
            self._lateness.add(late_us)
        out = rig.step(data, now_us)
        if rig.plugged != self._plugged:
            self._replug()
        if out and self._plugged:
            rig.take_back(out[port.write(out) :], now_us)
        if self._control is not None and not set(asked).isdisjoint(ready):
            self._control.turn(rig)
        self._report_changes()

    def report(self) -> ServeReport:
        """Return the statistics of the run."""
        return ServeReport(self._lateness, self._now_us() / 1e6)

    def _now_us(self) -> int:
        return (time.monotonic_ns() - self._start_ns) // 1000

    def _replug(self) -> None:
        self._plugged = self._rig.plugged
        if self._plugged:
            self._port.plug()
        else:
            self._port.unplug()
        if self._callbacks.on_plug is not None:
            self._callbacks.on_plug(self._port.path if self._plugged else None)

    def _report_changes(self) -> None:
        on_fault, on_truth = self._callbacks.on_fault, self._callbacks.on_truth
        for event in self._rig.faults.take_events():
            if on_fault is not None:
                on_fault(event, self._unix_at_boot_ns + event.t_us * 1000)
        if on_truth is None:
            return
        truth = self._rig.truth
        if truth.tick_ms != self._last_tick:
            self._last_tick = truth.tick_ms
            on_truth(truth, self._unix_at_boot_ns + truth.tick_ms * 1_000_000)
