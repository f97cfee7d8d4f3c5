"""Reader of a log that is still being written, or that is replayed at its recorded speed."""

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
_TRIES = 5
"""Number of attempts to find the next file of a run."""
_NS = 1e9


class Follower:
    """Reads the new messages of a growing log. It cannot delay the recording."""

    def __init__(self, path: Path, topics: Container[str] | None = None) -> None:
        self.path = path
        self.ended = False
        """True if the end of the log has been written."""
        self._first, self._number = path, 1
        self._topics = topics
        self._chunks = ChunkReader(topics)
        self._position: int | None = None

    def more(self) -> list[LogMessage]:
        """Return the messages of the chunks that were completed since the last call.

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

    def next_file(self) -> bool:
        """Continue with the next file of the run. Return False if there is none."""
        for _ in range(_TRIES):  # the recorder creates the next file after this file's end
            following = part_after(self._first, self._number)
            if following is not None:
                self.path, self.ended, self._position = following, False, None
                self._number += 1
                self._chunks = ChunkReader(self._topics)
                return True
            clock.pause(POLL_S)
        return False


def wait_for_log(path: Path, timeout_s: float) -> None:
    """Wait until a log exists.

    Raises:
        LogReadError: the log does not exist within ``timeout_s``.

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


def paced(  # noqa: PLR0913 - speed, limits, and two clocks for tests
    messages: Iterator[LogMessage],
    speed: float,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    period_s: float = POLL_S,
    moment: Callable[[], int] = clock.now,
    pause: Callable[[float], None] = clock.pause,
) -> Iterator[list[LogMessage]]:
    """Yield a log's messages in small batches, each at its time.

    Args:
        messages: Messages in the order of the file.
        speed: Seconds of the log for each second of real time.
        start_s: Start, s after the first message. Earlier messages are yielded at once, because the
            state at the start depends on them.
        end_s: End, s after the first message.
        period_s: Period of the batches, s of real time.
        moment: Monotonic clock, ns.
        pause: Function that waits for a number of seconds.

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
