"""A port that is only listened to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bridge.io import clock

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort
    from protocol.clock import HostNs

WAIT_S = 0.1
"""How soon an end that was asked for, or a picture that is due, is seen on a silent line."""


class Listener:
    """Takes bytes from a port until told to end; it has no way to write."""

    def __init__(self, port: BytePort) -> None:
        """Listen to this port; whoever opened it closes it."""
        self._wait = port.wait
        self._wake = port.wake
        self._ended = False

    def end(self) -> None:
        """End soon; from a signal handler or another thread."""
        self._ended = True
        self._wake()

    def run(self, take: Callable[[bytes, HostNs], None], duration_s: float | None = None) -> None:
        """Hand on what comes, with its time; empty bytes at least ten times a second.

        Raises:
            PortError: the port is gone.

        """
        end_ns = None if duration_s is None else clock.now() + round(duration_s * 1e9)
        while not self._ended:
            now_ns = clock.now()
            if end_ns is not None and now_ns >= end_ns:
                return
            left_s = WAIT_S if end_ns is None else min(WAIT_S, (end_ns - now_ns) / 1e9)
            data = self._wait(left_s)
            take(data, clock.now())
