"""The active faults, and their combined effect on device and link.

At each change, the injector computes all knobs (the values that faults change) again from the
active faults, in the order of their requests. So faults combine, and the end of a fault has no
effect on other faults.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from sim_device.faults.fault_target import FaultTarget, UnknownObstacleError
from sim_device.faults.kinds import KINDS, parse_fault_now
from sim_device.faults.knobs import Knobs
from sim_device.faults.spec import FaultSpec, FaultSpecError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from sim_device.rigged import RiggedDevice

_EVENTS_KEPT = 1000
_ALL: Mapping[str, str] = MappingProxyType({})
MAX_FAULTS = 1000
"""Maximum number of waiting and active faults. It limits the effect of a faulty script."""


@dataclass(frozen=True, slots=True)
class FaultEvent:
    """Event of a fault: a lasting fault began or ended, or a momentary fault was applied."""

    t_us: int
    """Time since power-on of the device, µs."""
    what: str
    """Kind of event: ``began``, ``struck`` (momentary fault), ``ended`` or ``cleared``."""
    spec: FaultSpec

    @property
    def text(self) -> str:
        """Return the event as a line of text."""
        return f"{self.spec.kind.name} {self.what} ({self.spec.text})"


@dataclass(slots=True)
class _Injected:
    spec: FaultSpec
    begin_us: int
    end_us: int | None
    active: bool = False


class FaultInjector:
    """Starts and ends the faults of one device, on schedule or on request."""

    def __init__(
        self,
        device: RiggedDevice,
        specs: Iterable[FaultSpec] = (),
        *,
        cannot: Mapping[str, str] = _ALL,
    ) -> None:
        """Schedule ``specs``; ``cannot`` maps the kinds that this device rejects to the reasons.

        Raises:
            FaultSpecError: this device rejects a fault in ``specs``.

        """
        self._target = FaultTarget(device)
        self._cannot = cannot
        self._now_us = 0
        self._faults: list[_Injected] = []
        self._changed = False
        self.knobs = Knobs()
        self.events: deque[FaultEvent] = deque(maxlen=_EVENTS_KEPT)
        """Events that :meth:`take_events` has not returned yet, oldest first."""
        for spec in specs:
            self.start(spec)

    # ---- requests -------------------------------------------------------------------------

    def start(self, fault: FaultSpec | str) -> FaultSpec:
        """Start a fault at its time; at once if the fault has no time or a time in the past.

        Raises:
            FaultSpecError: the text is no fault, or this device does not support it.

        """
        spec = self.check(fault)
        if len(self._faults) >= MAX_FAULTS:
            raise FaultSpecError(spec.text, f"{MAX_FAULTS} faults wait or are active already")
        begin_us = self._now_us
        if spec.at_s is not None:
            asked_us = round(spec.at_s * 1e6) + (self._now_us if spec.relative else 0)
            begin_us = max(asked_us, begin_us)
        end_us = None if spec.for_s is None else begin_us + round(spec.for_s * 1e6)
        self._faults.append(_Injected(spec, begin_us, end_us))
        return spec

    def check(self, fault: FaultSpec | str) -> FaultSpec:
        """Parse a fault without starting it.

        Raises:
            FaultSpecError: the text is no fault, or this device does not support it.

        """
        spec = parse_fault_now(fault) if isinstance(fault, str) else fault
        if spec.kind.name in self._cannot:
            raise FaultSpecError(spec.text, self._cannot[spec.kind.name])
        try:
            self._target.check(spec.values)
        except UnknownObstacleError as error:
            raise FaultSpecError(spec.text, str(error)) from None
        return spec

    def clear(self, kind: str | None = None) -> int:
        """End all active and waiting faults of a kind (None: of all kinds); return their number.

        Raises:
            FaultSpecError: the kind does not exist.

        """
        if kind is not None and kind not in KINDS:
            raise FaultSpecError(kind, f"there is no such kind; they are {', '.join(KINDS)}")
        gone = [f for f in self._faults if kind in {None, f.spec.kind.name}]
        for fault in gone:
            self._faults.remove(fault)
            if fault.active:
                self._changed = True
                self._add_event("cleared", fault.spec)
        return len(gone)

    @property
    def active(self) -> list[FaultSpec]:
        """Return the active lasting faults."""
        return [fault.spec for fault in self._faults if fault.active]

    @property
    def waiting(self) -> list[FaultSpec]:
        """Return the faults that have not started yet."""
        return [fault.spec for fault in self._faults if not fault.active]

    def take_events(self) -> list[FaultEvent]:
        """Return and remove the events so far."""
        events = list(self.events)
        self.events.clear()
        return events

    # ---- time -----------------------------------------------------------------------------

    def lived(self, now_us: int) -> None:
        """Set the present time, at which a fault without a time starts."""
        self._now_us = max(now_us, self._now_us)

    def next_us(self) -> int | None:
        """Time of the next change, µs; ``None``: no change is scheduled."""
        if self._changed:
            return self._now_us
        return min(self._edges(), default=None)

    def _edges(self) -> Iterator[int]:
        step_us = self._target.next_us()
        if step_us is not None:
            yield step_us
        for fault in self._faults:
            if not fault.active:
                yield fault.begin_us
            elif fault.end_us is not None:
                yield fault.end_us

    def run(self, now_us: int) -> bool:
        """Start and end the faults that are due; return whether the knobs changed."""
        self.lived(now_us)
        changed, self._changed = self._changed, False
        for fault in list(self._faults):
            if not fault.active and fault.begin_us <= now_us:
                changed |= self._begin(fault)
            if fault.active and fault.end_us is not None and fault.end_us <= now_us:
                self._faults.remove(fault)
                self._add_event("ended", fault.spec)
                changed = True
        if changed:
            self._turn()
        else:
            self._target.walk(now_us)
        return changed

    def _begin(self, fault: _Injected) -> bool:
        kind = fault.spec.kind
        if kind.strike is not None:
            self._faults.remove(fault)
            self._target.strike(kind.strike, fault.spec.values)
            self._add_event("struck", fault.spec)
            return False
        fault.active = True
        self._add_event("began", fault.spec)
        return True

    def _turn(self) -> None:
        self.knobs = Knobs()
        for fault in self._faults:
            if fault.active and fault.spec.kind.turn is not None:
                fault.spec.kind.turn(self.knobs, fault.spec.values)
        self._target.turn(self.knobs, self._now_us)

    def _add_event(self, what: str, spec: FaultSpec) -> None:
        self.events.append(FaultEvent(self._now_us, what, spec))
