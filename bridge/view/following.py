"""Reading a log while it is being written, or as fast as it was."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from bridge.io import clock
from bridge.record.errors import LogReadError
from bridge.record.family import part_after
from bridge.record.reader import ChunkReader
from bridge.record.scan import DamagedBytes, opened, records
from bridge.record.unpack import DAMAGE

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator
    from pathlib import Path

    from bridge.record.reader import LogMessage

POLL_S = 0.1
_PATIENCE = 5
_NS = 1e9


class Follower:
    """A log that grows: gives what has come since the last time.

    The writer never learns of it: whatever a reader does, it cannot delay the recording.
    """

    def __init__(self, path: Path, topics: Container[str] | None = None) -> None:
        self.path = path
        self.ended = False
        """Its end has been written."""
        self._first, self._number = path, 1
        self._topics = topics
        self._chunks = ChunkReader(topics)
        self._position: int | None = None

    def more(self) -> list[LogMessage]:
        """Messages of the chunks that are whole by now.

        Raises:
            LogReadError: the file is missing, cannot be read, or is no MCAP file.

        """
        found: list[LogMessage] = []
        with opened(self.path) as data:
            start = records(data) if self._position is None else records(data, self._position)
            for record in start:
                if isinstance(record, DamagedBytes):
                    if not record.is_tail:
                        self._position = record.end
                    continue
                self._position = record.end
                if self._chunks.is_end(record.opcode):
                    self.ended = True
                    break
                with contextlib.suppress(*DAMAGE):
                    found += self._chunks.messages(record.opcode, data[record.start : record.end])
        return found

    def go_on(self) -> bool:
        """Turn to the file in which the run goes on, where there is one."""
        for _ in range(_PATIENCE):  # it is begun just after this one was ended
            following = part_after(self._first, self._number)
            if following is not None:
                self.path, self.ended, self._position = following, False, None
                self._number += 1
                self._chunks = ChunkReader(self._topics)
                return True
            clock.pause(POLL_S)
        return False


def wait_for_log(path: Path, timeout_s: float) -> None:
    """Wait until a log has been begun.

    Raises:
        LogReadError: it has not, in this time.

    """
    end_s = clock.now() / _NS + timeout_s
    while True:
        try:
            with opened(path):
                return
        except LogReadError:
            if clock.now() / _NS >= end_s:
                raise
        clock.pause(POLL_S)


def paced(  # noqa: PLR0913 - how, from where, to where, and two clocks for tests
    messages: Iterator[LogMessage],
    speed: float,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    period_s: float = POLL_S,
    moment: Callable[[], int] = clock.now,
    pause: Callable[[float], None] = clock.pause,
) -> Iterator[list[LogMessage]]:
    """A log's messages in small batches, each when its time has come.

    Args:
        messages: In the order of the file.
        speed: Seconds of the log for each second that passes.
        start_s: What lies before, from the first message, comes at once: it leads to that state.
        end_s: Where to end, from the first message.
        period_s: Of the batches.
        moment: Monotonic clock, ns.
        pause: Waits for so many seconds.

    """
    batch: list[LogMessage] = []
    begun_ns: int | None = None
    first_ns = 0
    due_s = start_s
    for message in messages:
        if begun_ns is None:
            begun_ns, first_ns = moment(), message.log_ns
        at_s = (message.log_ns - first_ns) / _NS
        if end_s is not None and at_s > end_s:
            break
        while at_s > due_s:
            yield batch
            batch = []
            due_s += period_s * speed
            ahead_s = (due_s - start_s) / speed - (moment() - begun_ns) / _NS
            if ahead_s > 0:
                pause(ahead_s)
        batch.append(message)
    yield batch
