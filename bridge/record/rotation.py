"""A run in several files. Each file is readable without the others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from bridge.record.family import part_name
from bridge.session.event_kinds import EventKind
from bridge.session.records import (
    ClockRecord,
    CoverageRecord,
    DeviceMessage,
    EventRecord,
    IdentityRecord,
    PlannerRecord,
    RoomRecord,
    Severity,
)
from protocol.messages.device import ImuInfo

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from bridge.record.log_writer import RunWriter
    from bridge.session.records import Record, RunInfo

_NS = 1_000_000_000
_STATE = (IdentityRecord, RoomRecord, ClockRecord, CoverageRecord, PlannerRecord)
"""Types of records that describe a state. The newest record of each type starts the next file."""
_EVERY = 64
"""Number of records between two checks of the file's size."""


class RotatingWriter:
    """Writes a run to ``NAME.mcap``, ``NAME-0002.mcap`` and so on.

    It starts a new file when the current file reaches its maximum size or age. The change happens
    between two records, so no record is lost or duplicated. Each file repeats attachments,
    metadata, schemas and the newest state. The last file has the run's summary.
    """

    def __init__(
        self,
        path: Path,
        info: RunInfo,
        make: Callable[[Path, RunInfo], RunWriter],
        *,
        rotate_bytes: int | None = None,
        rotate_s: float | None = None,
    ) -> None:
        """Create the first file.

        Args:
            path: Path of the first file.
            info: Header data of every file. The part's number is added.
            make: Function that creates a file.
            rotate_bytes: Size at which a new file starts, bytes; None: unlimited.
            rotate_s: Log time after which a new file starts, s; None: unlimited.

        Raises:
            OutputExistsError: the file exists and may not be replaced.
            LogWriteError: the file cannot be opened or written.

        """
        self.path = path
        self.parts: list[Path] = []
        self._first, self._info, self._make = path, info, make
        self._bytes, self._span_ns = rotate_bytes, round(rotate_s * _NS) if rotate_s else None
        self._state: dict[type, Record] = {}
        """The newest record of each state, by its type; for ``imu_info``, by the message's type."""
        self._count = 0
        self._begun_ns = info.opened_unix_ns
        self._writer = self._begin()

    def write(self, record: Record) -> None:
        """Write one record to the current file, or to a new one.

        Raises:
            LogWriteError: the file cannot be written.

        """
        log_ns = record[0]
        self._count += 1
        if self._is_full(log_ns):
            self._rotate(log_ns)
        if isinstance(record, _STATE):
            self._state[type(record)] = record
        elif isinstance(record, DeviceMessage) and isinstance(record.message, ImuInfo):
            self._state[ImuInfo] = record  # needed for the IMU's SI values in the next file
        self._writer.write(record)

    def flush(self) -> None:
        """Write the open chunk.

        Raises:
            LogWriteError: the file cannot be written.

        """
        self._writer.flush()

    def close(self, summary: Mapping[str, Any] | None = None) -> None:
        """Attach the summary to the current file and complete it. It may be called again.

        Raises:
            LogWriteError: the end could not be written.

        """
        self._writer.close(summary)

    def _is_full(self, log_ns: int) -> bool:
        if self._span_ns is not None and log_ns - self._begun_ns >= self._span_ns:
            return True
        if self._bytes is None or self._count % _EVERY:
            return False
        return self._writer.bytes_written >= self._bytes

    def _rotate(self, log_ns: int) -> None:
        following = part_name(self._first, len(self.parts) + 1)
        text = f"the log continues in {following.name}"
        data = {"next": following.name}
        self._writer.write(
            EventRecord(log_ns, Severity.INFO, "recorder", EventKind.ROTATED, text, data)
        )
        self._writer.close()
        self._begun_ns, self._count = log_ns, 0
        before, self._writer = self._writer.path, self._begin()
        text = f"the log continues from {before.name}"
        data = {"previous": before.name}
        self._writer.write(
            EventRecord(log_ns, Severity.INFO, "recorder", EventKind.ROTATED, text, data)
        )
        for record in self._state.values():
            self._writer.write(record._replace(log_ns=log_ns))

    def _begin(self) -> RunWriter:
        number = len(self.parts) + 1
        extra = {**self._info.extra, "part": str(number)}
        if self.parts:
            extra["previous"] = self.parts[-1].name
        self.path = part_name(self._first, number)
        begun_ns = self._begun_ns if self.parts else None
        info = replace(self._info, extra=extra, begun_unix_ns=begun_ns)
        writer = self._make(self.path, info)
        self.parts.append(self.path)
        return writer
