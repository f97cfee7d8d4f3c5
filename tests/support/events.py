"""A sink that stores the events of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.record.sink import NullSink
from bridge.session.records import EventRecord

if TYPE_CHECKING:
    from bridge.session.records import Record


class Events(NullSink):
    """Stores events and ignores all other records."""

    def __init__(self) -> None:
        self.events: list[EventRecord] = []

    def write(self, record: Record) -> None:
        if isinstance(record, EventRecord):
            self.events.append(record)
