"""Output that never makes its writer wait: a bounded queue, and a thread that writes it out.

A full pipe, a terminal held by Ctrl-S or one whose reader hangs blocks ``write`` for as long as it
likes. A loop that drives a robot must not wait for that.
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
"""Bytes that wait for a terminal, and for a pipe or file. A terminal gets the last few pictures
and lines; a program gets 4 s of the lines of a full line at 3 Mbaud."""
_PIECE = 512
"""Bytes of one system call: small, so that a reader that still reads, however slowly, shows it.
At 9600 baud this takes 0.53 s."""
IDLE_S = 0.6
"""Time without a byte taken after which nobody reads, at the end of a command, seconds. Longer
than a piece takes at 9600 baud."""
_END_S = 5.0
"""Time that the end of a command waits for a slow reader at most, seconds."""


class QueuedStream(io.TextIOBase):
    """A text stream over a file descriptor; writing to it takes no time.

    What finds no room is dropped, whole writes at a time, and counted; the count is printed once
    the reader is back.
    """

    def __init__(
        self, stream: TextIO, *, raises: bool = False, notices: QueuedStream | None = None
    ) -> None:
        """With ``raises`` a write after one that failed raises the same error.

        ``notices`` gets the count of dropped lines; None: this stream itself.
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
        """Bytes not yet written, those that are being written included."""
        self._busy = False
        """Whether the thread has something in hand."""
        self._dropped = 0
        self._thread: threading.Thread | None = None
        self.error: OSError | None = None
        """Why nothing more can be written."""

    @property
    def encoding(self) -> str:  # type: ignore[override]  # typeshed has an attribute
        """Of the stream below."""
        return self._encoding

    @property
    def errors(self) -> str:  # type: ignore[override]  # as above
        """Of the stream below."""
        return self._errors

    def fileno(self) -> int:
        """Of the stream below."""
        return self._fd

    def isatty(self) -> bool:
        """Whether a terminal reads."""
        return self._terminal

    def writable(self) -> bool:
        """It is."""
        return True

    def flush(self) -> None:
        """Nothing waits here for a flush."""

    def write(self, text: str) -> int:
        """Queue a text.

        Raises:
            OSError: what was written before could not be, and this stream ``raises``.

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
                    # Not waited for at the end: it may be in a write that never returns.
                    self._thread = threading.Thread(target=self._run, name="output", daemon=True)
                    self._thread.start()
                self._news.notify_all()
        return len(text)

    def drop_queued(self) -> None:
        """Drop what waits: pictures that newer ones replace. What is half written stays."""
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
                    text = f"sweepctl: {self._dropped} lines were dropped: nobody read them\n"
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
        """Wait for the queue to empty: as long as its reader reads, and ``limit_s`` at most."""
        until_s = time.monotonic() + limit_s
        with self._news:
            while not self._done:
                wait_s = min(IDLE_S, until_s - time.monotonic())
                if wait_s <= 0 or not self._news.wait(wait_s):  # nothing was taken meanwhile
                    return


class QueuedOutput:
    """Meanwhile stdout and stderr are queued; streams without a file descriptor stay as they are.

    At the end what is queued is waited for, as :meth:`QueuedStream.drain` does.
    """

    def __init__(self) -> None:
        """Nothing is queued before it is entered."""
        self.error: OSError | None = None
        """Why stdout could not be written, once it is over."""

    def __enter__(self) -> Self:
        """Queue from now on."""
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
        """Wait for the readers, and give the streams back."""
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
        stream.flush()  # what it holds comes before what is queued
    except (OSError, ValueError):  # io.UnsupportedOperation is both
        return False
    return True
