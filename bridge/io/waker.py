"""Wake-up of a thread that waits for descriptors."""

from __future__ import annotations

import os
from contextlib import suppress
from threading import RLock


class Waker:
    """A pipe that becomes readable on request.

    The lock prevents a wake after the pipe is closed, because its descriptor may then belong to
    another file. The lock is re-entrant, because a signal handler may call :meth:`wake` during
    :meth:`close` in the same thread.
    """

    def __init__(self) -> None:
        """Open the pipe."""
        self._lock = RLock()
        self._closed = False
        self.fd, self._write = os.pipe()
        os.set_blocking(self.fd, False)
        os.set_blocking(self._write, False)

    def wake(self) -> None:
        """End a wait now. It is safe in a signal handler and has no effect after :meth:`close`."""
        with self._lock:
            if not self._closed:
                with suppress(OSError):
                    os.write(self._write, b"!")

    def drain(self) -> None:
        """Read and discard all wakes."""
        with suppress(OSError):
            while os.read(self.fd, 64):
                pass

    def close(self) -> None:
        """Close the pipe."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            for end in (self.fd, self._write):
                with suppress(OSError):
                    os.close(end)
