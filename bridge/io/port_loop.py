"""Loop of a port for small tasks: a stop, a short session, a listener.

The loop of a run, which reopens its port and serves other threads, is :mod:`bridge.api.pump`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from bridge.io import clock

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort
    from protocol.clock import HostNs

MAX_WAIT_S = 0.1
"""Maximum wait on a silent port, s. It is also the maximum delay of an end request."""


class Engine(Protocol):
    """Sans-I/O user of a port."""

    def receive(self, data: bytes, now_ns: HostNs) -> None:
        """Handle received bytes, which may be empty."""

    def data_to_send(self, now_ns: HostNs) -> bytes:
        """Return the bytes to send, usually none."""

    def next_deadline(self) -> HostNs | None:
        """Return the next time at which something is due; None: nothing is due before reception."""


class Listening:
    """Engine that only receives."""

    def __init__(self, take: Callable[[bytes, HostNs], None]) -> None:
        """Create an engine; ``take`` gets received bytes and their time at least every 0.1 s."""
        self.receive = take

    def data_to_send(self, now_ns: HostNs) -> bytes:  # noqa: ARG002 - the interface of an engine
        """Return no bytes."""
        return b""

    def next_deadline(self) -> None:
        """Return None: nothing is ever due."""
        return


def serve(
    port: BytePort,
    engine: Engine,
    end_ns: HostNs | None,
    ended: Callable[[], bool] = lambda: False,
    sent: Callable[[bytes, HostNs], None] = lambda _data, _now_ns: None,
) -> None:
    """Transfer bytes between a port and an engine.

    Args:
        port: An open port; the caller closes it.
        engine: User of the port.
        end_ns: Latest end; None: only ``ended`` ends the loop.
        ended: Called in each pass; True ends the loop.
        sent: Called with the written bytes and the time.

    Raises:
        PortError: the port is gone.

    """
    rest = b""
    while not ended():
        now_ns = clock.now()
        if end_ns is not None and now_ns >= end_ns:
            return
        due = engine.data_to_send(now_ns)
        if due:
            rest = due  # replaces an unsent rest; its frame becomes damaged
        if rest:
            written = port.write(rest)
            sent(rest[:written], now_ns)
            rest = rest[written:]
        wakes_ns = [wake for wake in (engine.next_deadline(), end_ns) if wake is not None]
        wait_s = min(((wake_ns - clock.now()) / 1e9 for wake_ns in wakes_ns), default=MAX_WAIT_S)
        data = port.wait(max(0.0, min(wait_s, MAX_WAIT_S)))
        engine.receive(data, clock.now())
