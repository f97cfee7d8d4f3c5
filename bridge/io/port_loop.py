"""The loop of a port that serves something smaller than a run: a stop, a visit, a listener.

A run's own loop, which reopens its port and answers other threads, is :mod:`bridge.api.pump`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from bridge.io import clock

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort
    from protocol.clock import HostNs

MAX_WAIT_S = 0.1
"""Longest wait on a silent port, s: how soon an end that was asked for is seen."""


class Engine(Protocol):
    """What a port carries bytes for; it has no clock and no port of its own."""

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Take what came, which may be nothing."""

    def data_to_send(self, now_ns: HostNs) -> bytes:
        """Give what is due; nothing most of the time."""

    def next_deadline(self) -> HostNs | None:
        """When something is due next; None: only after something came."""


class Listening:
    """An engine that only listens: it has no way to send."""

    def __init__(self, take: Callable[[bytes, HostNs], None]) -> None:
        """``take`` gets what came and when, at least ten times a second."""
        self.receive = take

    def data_to_send(self, now_ns: HostNs) -> bytes:  # noqa: ARG002 - an engine's interface
        """Give nothing."""
        return b""

    def next_deadline(self) -> None:
        """Never."""
        return


def serve(
    port: BytePort,
    engine: Engine,
    end_ns: HostNs | None,
    ended: Callable[[], bool] = lambda: False,
    sent: Callable[[bytes, HostNs], None] = lambda _data, _now_ns: None,
) -> None:
    """Carry bytes between a port and an engine.

    Args:
        port: An open port; the caller closes it.
        engine: What it is for.
        end_ns: When to end at the latest; None: only when ``ended`` says so.
        ended: Asked at each turn whether to end.
        sent: Gets what was written, and when.

    Raises:
        PortError: the port has vanished.

    """
    rest = b""
    while not ended():
        now_ns = clock.now()
        if end_ns is not None and now_ns >= end_ns:
            return
        due = engine.data_to_send(now_ns)
        if due:
            rest = due  # what the port did not take of the one before is damaged, and replaced
        if rest:
            written = port.write(rest)
            sent(rest[:written], now_ns)
            rest = rest[written:]
        wakes_ns = [wake for wake in (engine.next_deadline(), end_ns) if wake is not None]
        wait_s = min(((wake_ns - clock.now()) / 1e9 for wake_ns in wakes_ns), default=MAX_WAIT_S)
        data = port.wait(max(0.0, min(wait_s, MAX_WAIT_S)))
        engine.receive(data, clock.now())
