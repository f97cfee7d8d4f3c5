"""Output that never blocks its writer: a bounded queue, and a thread that writes its content.

If a pipe is full, or a terminal hangs or is paused with Ctrl-S, ``write`` blocks without a limit.
A loop that drives a robot must not block in ``write``.
"""

from __future__ import annotations

import io
import os
import sys
import threading
import time  # noqa: TID251 - waits for a reader at the end, in real time
from collections import deque
from typing import TYPE_CHECKING, Self, TextIO

if TYPE_CHECKING:
    from types import TracebackType

QUEUE_BYTES = {True: 1 << 16, False: 1 << 22}
"""Size of the queue for a terminal (True) and for a pipe or file (False), bytes. For a terminal it
is enough for the last few screens. For a pipe it is enough for 4 s of ``monitor --lines`` on a
fully used link at 3 Mbaud."""
_PIECE = 512
"""Number of bytes per system call. The number is small, so that progress is visible even with a
slow reader: at 9600 baud a call takes 0.53 s."""
IDLE_S = 0.6
"""Time without progress after which a command no longer waits for its reader at the end, s. The
time is longer than the 0.53 s that ``_PIECE`` takes at 9600 baud."""
_END_S = 5.0
"""Maximum time that the end of a command waits for a slow reader, s."""


class QueuedStream(io.TextIOBase):
    """A text stream over a file descriptor whose ``write`` never blocks.

    If the queue is full, each further write is dropped completely and counted. The count is printed
    when the reader reads again.
    """

    def __init__(
        self, stream: TextIO, *, raises: bool = False, notices: QueuedStream | None = None
    ) -> None:
        """Queue writes to ``stream``.

        Args:
            stream: where the text goes; it must have a file descriptor.
            raises: after a write has failed, each further write raises this error.
            notices: where the count of dropped lines is printed; None: this stream.

        """
        self._fd = stream.fileno()
        self._encoding, self._errors = stream.encoding or "utf-8", stream.errors or "replace"
        self._terminal = stream.isatty()
        self._raises = raises
        self._notices = notices
        self._limit = QUEUE_BYTES[self._terminal]
        self._news = threading.Condition()
        self._queue: deque[bytes] = deque()
        self._waiting = 0
        """Number of bytes that are not yet written completely."""
        self._busy = False
        """True while the thread writes."""
        self._dropped = 0
        self._thread: threading.Thread | None = None
        self.error: OSError | None = None
        """Error that prevents further output; None: no write has failed."""

    @property
    def encoding(self) -> str:  # type: ignore[override]  # typeshed declares an attribute
        """Encoding of the stream below."""
        return self._encoding

    @property
    def errors(self) -> str:  # type: ignore[override]  # typeshed declares an attribute
        """Error handler of the stream below."""
        return self._errors

    def fileno(self) -> int:
        """Return the descriptor of the stream below."""
        return self._fd

    def isatty(self) -> bool:
        """Return whether the stream below is a terminal."""
        return self._terminal

    def writable(self) -> bool:
        """Return True, as ``print`` expects."""
        return True

    def flush(self) -> None:
        """Do nothing, because the thread writes by itself."""

    def write(self, text: str) -> int:
        """Queue a text.

        Raises:
            OSError: an earlier write failed, and this stream ``raises``.

        """
        data = text.encode(self._encoding, self._errors)
        with self._news:
            if self.error is not None:
                if self._raises:
                    raise self.error
            elif self._queue and self._waiting + len(data) > self._limit:
                self._dropped += max(1, data.count(b"\n"))
            elif data:
                self._queue.append(data)
                self._waiting += len(data)
                if self._thread is None:
                    # A daemon, because its write may never return.
                    self._thread = threading.Thread(target=self._run, name="output", daemon=True)
                    self._thread.start()
                self._news.notify_all()
        return len(text)

    def drop_queued(self) -> None:
        """Drop the queued writes, such as old screens of a display.

        A write that has begun is completed.
        """
        with self._news:
            self._waiting -= sum(map(len, self._queue))
            self._queue.clear()

    def _run(self) -> None:
        while self.error is None:
            with self._news:
                self._news.wait_for(lambda: self._queue)
                data = self._queue.popleft()
                self._busy = True
            try:
                self._put(data)
            except OSError as error:
                with self._news:
                    self.error = error
                    self._queue.clear()
            with self._news:
                if self._dropped and not self._queue and self.error is None:
                    text = f"sweepctl: {self._dropped} lines were dropped: the reader is too slow\n"
                    self._dropped = 0
                    (self._notices or self).write(text)
                self._busy = False
                self._news.notify_all()

    def _put(self, data: bytes) -> None:
        while data:
            written = os.write(self._fd, data[:_PIECE])
            data = data[written:]
            with self._news:
                self._waiting -= written
                self._news.notify_all()

    @property
    def _done(self) -> bool:
        return self.error is not None or not (self._queue or self._busy)

    def drain(self, limit_s: float = _END_S) -> None:
        """Wait until the queue is empty, its reader stops reading, or ``limit_s`` has passed."""
        until_s = time.monotonic() + limit_s
        with self._news:
            while not self._done:
                wait_s = min(IDLE_S, until_s - time.monotonic())
                if wait_s <= 0 or not self._news.wait(wait_s):  # no progress
                    return


class QueuedOutput:
    """Context in which stdout and stderr are queued, if they have a file descriptor.

    Its end waits for the readers as :meth:`QueuedStream.drain` does.
    """

    def __init__(self) -> None:
        """Prepare; queueing begins with ``__enter__``."""
        self.error: OSError | None = None
        """Error that prevented output to stdout; set at the end of the context."""

    def __enter__(self) -> Self:
        """Replace stdout and stderr by queued streams."""
        self._before = sys.stdout, sys.stderr
        self._err = QueuedStream(sys.stderr) if _has_descriptor(sys.stderr) else None
        self._out = None
        if _has_descriptor(sys.stdout):
            self._out = QueuedStream(sys.stdout, raises=True, notices=self._err)
        sys.stdout, sys.stderr = self._out or sys.stdout, self._err or sys.stderr
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Wait for the readers and restore the streams."""
        try:
            for stream in (self._out, self._err):
                if stream is not None:
                    stream.drain()
        finally:
            sys.stdout, sys.stderr = self._before
            self.error = None if self._out is None else self._out.error


def _has_descriptor(stream: TextIO) -> bool:
    try:
        stream.fileno()
        stream.flush()  # buffered text comes before queued text
    except (OSError, ValueError):  # io.UnsupportedOperation is a subclass of both
        return False
    return True
