"""Ends another thread's wait for descriptors."""

from __future__ import annotations

import os
from contextlib import suppress
from threading import RLock


class Waker:
    """A pipe that becomes readable when somebody asks for it.

    The lock keeps a wake from a pipe that is being closed, whose number may already be another
    file's. It is re-entrant: a signal handler may ask while its own thread closes.
    """

    def __init__(self) -> None:
        """Open the pipe."""
        self._lock = RLock()
        self._closed = False
        self.fd, self._write = os.pipe()
        os.set_blocking(self.fd, False)
        os.set_blocking(self._write, False)

    def wake(self) -> None:
        """End a wait now; safe in a signal handler. A closed one has nobody to wake."""
        with self._lock:
            if not self._closed:
                with suppress(OSError):
                    os.write(self._write, b"!")

    def drain(self) -> None:
        """Take all wakes that have come."""
        with suppress(OSError):
            while os.read(self.fd, 64):
                pass

    def close(self) -> None:
        """Give the pipe back."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            for end in (self.fd, self._write):
                with suppress(OSError):
                    os.close(end)
