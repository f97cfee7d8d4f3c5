"""The one loop that owns a port: bytes in, timers, bytes out, and reopening."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from bridge.errors import PortError
from bridge.io import clock
from bridge.mission import Ending
from bridge.telemetry import Severity
from protocol.clock import HostNs

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.host import Host
    from bridge.io.ports import BytePort

_BACKOFF_NS = (250_000_000, 500_000_000, 1_000_000_000, 2_000_000_000)
_IDLE_S = 0.25
STUCK_NS = 50_000_000
"""Nothing older goes out: what a port did not take by then is dropped, and told."""


class Pump:
    """Runs a host on a port until its run is done."""

    def __init__(self, host: Host, port: BytePort, reopen: Callable[[], BytePort]) -> None:
        """``reopen`` opens the same device again after its port has vanished."""
        self.host = host
        self.watch: Callable[[], Ending | None] = lambda: None
        """Asked at every turn whether something outside demands an end."""
        self.on_reopened: Callable[[str], None] = lambda _name: None
        """Told the name under which a port that had vanished was opened again."""
        self._port: BytePort | None = port
        self._reopen = reopen
        self._pending = b""
        self._fetched_ns = HostNs(0)
        self._stuck = False
        self._ask: Ending | None = None
        self._calls: deque[Callable[[], None]] = deque()
        self._end_at_ns: HostNs | None = None
        self._tries = 0
        self._retry_ns = HostNs(0)

    def request_end(self, ending: Ending) -> None:
        """End the run in order; from a signal handler or another thread."""
        self._ask = ending
        port = self._port
        if port is not None:
            port.wake()

    def call(self, action: Callable[[], None]) -> None:
        """Run something in the loop's own thread, at its next turn."""
        self._calls.append(action)
        port = self._port
        if port is not None:
            port.wake()

    def end_after(self, duration_s: float) -> None:
        """End the run in order after this long; not before a device was found or given up."""
        self._end_at_ns = HostNs(clock.now() + round(duration_s * 1e9))

    def run(self) -> None:
        """Loop until the run is done; the port is closed then."""
        host = self.host
        host.open(clock.now())
        try:
            while not host.mission.done:
                self._once()
        finally:
            self._flush()
            if self._port is not None:
                self._port.close()

    def _once(self) -> None:
        host = self.host
        now_ns = clock.now()
        wait_s = min(_IDLE_S, max(0.0, (host.next_deadline() - now_ns) / 1e9))
        data = b""
        if self._port is None:
            self._try_reopen(now_ns)
        if self._port is not None:
            try:
                data = self._port.wait(wait_s)
            except PortError as error:
                self._gone(error, now_ns)
        now_ns = clock.now()
        host.receive(data, now_ns)
        if self._calls:
            while self._calls:
                self._calls.popleft()()
            self._write(now_ns)  # what was asked for does not wait for the control step
        ending = self._ask
        if ending is None:  # cleared only where it was seen: a signal may come between any lines
            ending = self.watch()
        else:
            self._ask = None
        if ending is not None:
            host.end(ending, now_ns)
        if self._end_at_ns is not None and now_ns >= self._end_at_ns and host.hello is not None:
            self._end_at_ns = None
            host.end(Ending("stopped", "the time asked for is over", 0), now_ns)
        host.poll(now_ns)
        self._write(now_ns)

    def _write(self, now_ns: HostNs) -> None:
        # New bytes are fetched only once the old ones are gone: what waits in the link's
        # queue can still be superseded, what waits here cannot.
        port = self._port
        if port is None:
            self.host.discard_output()
            return
        if self._pending and now_ns - self._fetched_ns > STUCK_NS:
            self._drop_stuck(now_ns)
        fresh = b""
        if not self._pending:
            self._pending = fresh = self.host.session.data_to_send()
            self._fetched_ns = now_ns
        if not self._pending:
            return
        try:
            self._pending = self._pending[port.write(self._pending) :]
        except PortError as error:
            self._gone(error, now_ns)
        else:
            self._stuck = self._stuck and bool(self._pending)
        self.host.sent(fresh, now_ns)  # on its way first: the far end does not wait for the log

    def _drop_stuck(self, now_ns: HostNs) -> None:
        # The frame that is cut short is damaged at the far end, and no other: each batch
        # begins with a delimiter. Stops and commands are repeated by the session.
        if not self._stuck:
            self._stuck = True
            text = f"the port takes no bytes; {len(self._pending)} bytes are dropped"
            self.host.event(now_ns, Severity.WARNING, "link", "stuck", text)
        self._pending = b""

    def _flush(self) -> None:
        for _ in range(10):
            self._write(clock.now())
            if not self._pending:
                return

    def _gone(self, error: PortError, now_ns: HostNs) -> None:
        self.host.event(now_ns, Severity.ERROR, "link", "port_lost", str(error))
        self.host.session.unplugged(now_ns)
        if self._port is not None:
            self._port.close()
        self._port = None
        self._pending = b""
        self._tries = 0
        self._retry_ns = HostNs(now_ns + _BACKOFF_NS[0])

    def _try_reopen(self, now_ns: HostNs) -> None:
        if now_ns < self._retry_ns:
            clock.pause(min(_IDLE_S, (self._retry_ns - now_ns) / 1e9, 0.02))
            return
        try:
            self._port = self._reopen()
        except PortError:
            self._tries += 1
            backoff = _BACKOFF_NS[min(self._tries, len(_BACKOFF_NS) - 1)]
            self._retry_ns = HostNs(now_ns + backoff)
            return
        self.host.event(now_ns, Severity.INFO, "link", "port_back", f"{self._port.name} is back")
        self.host.session.replugged(now_ns)
        self.on_reopened(self._port.name)
