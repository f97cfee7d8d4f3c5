"""Recording of a bring-up or a calibration: bytes, messages, clock and printed lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.run.recording import HostRecords
from bridge.session.event_kinds import EventKind
from bridge.session.ingest import Ingest
from bridge.session.records import Severity
from bridge.session.states import Data, Failed, Ping, Restless, SessionReady, StateChanged
from bridge.session.timesync import TimeSync
from protocol.can.link import CanLink
from protocol.messages.device import LogText
from protocol.uart.framing import DamagedFrame

if TYPE_CHECKING:
    from bridge.bringup.port import BringupPort
    from bridge.record.sink import Sink
    from bridge.session.states import SessionEvent
    from protocol.clock import HostNs

_CLOCK_NS = 1_000_000_000
"""Period of the records of the time synchronisation, ns. It is the same as in a run."""


class BringupRecords:
    """Records all data between a bring-up session and its device."""

    def __init__(self, wire: BringupPort, sink: Sink, unix_offset_ns: int) -> None:
        """Create a recorder; ``unix_offset_ns`` is Unix time minus the time of ``wire``, ns."""
        self._wire, self._sink = wire, sink
        self._ingest = Ingest(TimeSync(), unix_offset_ns)
        is_bus = issubclass(wire.link, CanLink)
        self._records = HostRecords(sink, unix_offset_ns, "", bus=is_bus)
        self._tap = self._records.can if is_bus else self._records.uart
        self._clock_ns = wire.now()
        self._ready: SessionReady | None = None

    def opened(self, now_ns: HostNs) -> None:
        """Record the start of the session."""
        self._records.event(now_ns, Severity.INFO, "session", EventKind.OPENING, "bring-up")

    def passed(self, data: bytes, now_ns: HostNs, *, outgoing: bool) -> None:
        """Record bytes that were sent or received."""
        self._tap(data, now_ns, outgoing=outgoing)
        self._records.flush(now_ns)

    def closed(self) -> None:
        """Record the collected damaged data that is not yet recorded."""
        self._records.flush(self._wire.now(), at_once=True)

    def record_line(self, text: str) -> None:
        """Record a line that was printed."""
        self._records.event(self._wire.now(), Severity.INFO, "bringup", EventKind.PRINTED, text)

    def received(self, events: list[SessionEvent], now_ns: HostNs) -> None:
        """Record the events of a session that have the same time."""
        for event in events:
            match event:
                case Data():
                    self._sink.write(self._ingest.take(event.received, now_ns))
                    message = event.received.message
                    if isinstance(message, LogText):
                        self._records.log_text(message, now_ns)
                case _:
                    self._happened(event, now_ns)
        if self._ready is not None and now_ns - self._clock_ns >= _CLOCK_NS:
            self._clock_ns = now_ns
            self._records.clock(self._ingest.sync, self._ready.hello, now_ns)

    def _happened(self, event: SessionEvent, now_ns: HostNs) -> None:
        match event:
            case Ping():
                self._ingest.exchange(event)
            case SessionReady():
                self._ready = event
                self._records.identity(event, now_ns)
                if event.rebooted:
                    self._ingest.reset()
            case DamagedFrame():
                self._records.damaged([event], now_ns)
            case StateChanged():
                self._records.event(
                    now_ns, Severity.INFO, "session", EventKind(event.new.value), event.why
                )
            case Restless():
                self._records.event(
                    now_ns, Severity.WARNING, "session", EventKind.RESTLESS, event.text
                )
            case Failed():
                self._records.event(now_ns, Severity.ERROR, "session", event.kind, event.text)
            case _:
                pass
