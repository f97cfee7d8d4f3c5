"""The one loop that owns a port: bytes in, timers, bytes out, and reopening."""

from __future__ import annotations

import threading
from collections import deque
from concurrent.futures import Future
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from bridge.errors import BridgeError, DeviceLostError, PortError
from bridge.io import clock
from bridge.io.identifiers import new_command_id
from bridge.io.stopping import send_until_confirmed
from bridge.run.ending import CRASH_CAUSE, Ending, crash_ending, described, traced
from bridge.run.mission import Phase
from bridge.session.event_kinds import EventKind
from bridge.session.records import Severity
from bridge.session.states import State
from bridge.session.stop_request import StopRequest
from protocol.clock import HostNs
from protocol.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort
    from bridge.run.host import Host
    from bridge.run.snapshot import Snapshot

_BACKOFF_NS = (250_000_000, 500_000_000, 1_000_000_000, 2_000_000_000)
_IDLE_S = 0.25
STUCK_NS = 50_000_000
"""Nothing older goes out: what a port did not take by then is dropped, and told."""
CRASH_STOP_NS = 1_000_000_000
"""How long a loop that has failed repeats its stop, nanoseconds: as long as an orderly end
waits for the device's confirmation."""
LOOK_PERIOD_NS = 2_000_000
"""Shortest time between two snapshots for other threads, ns: each takes the loop some 10 µs, and a
line at 3 Mbaud wakes it a thousand times a second."""
R = TypeVar("R")


class Result(NamedTuple):
    """How a loop ended; made once, when its port is closed."""

    ending: Ending
    confirmed: StopCause
    """The gravest cause whose stop the device has acknowledged; ``NONE``: it has confirmed no
    stop."""


class Pump:
    """Runs a host on a port until its run is done.

    Everything that the host is made of belongs to the loop's thread. Another thread asks for an
    end (:meth:`request_end`), has something run in the loop (:meth:`call`), and looks at
    :attr:`result`.
    """

    def __init__(self, host: Host, port: BytePort, reopen: Callable[[], BytePort]) -> None:
        """``reopen`` opens the same device again after its port has vanished."""
        self.host = host
        self.watch: Callable[[], Ending | None] = lambda: None
        """Asked at every turn whether something outside demands an end."""
        self.on_reopened: Callable[[str], None] = lambda _name: None
        """Told the name under which a port that had vanished was opened again."""
        self.crash: BaseException | None = None
        """The exception that has ended the loop; None: it ended in order, or runs."""
        self.result: Result | None = None
        """How the loop ended; None: it has not begun, or runs."""
        self.snapshot = host.snapshot()
        """What is known of the robot and its run, made in the loop; for any thread to read."""
        self._looked_ns = 0
        self.turn_ns = clock.now()
        """When the loop's newest turn began; old where the loop hangs."""
        self._over = threading.Event()
        self._port: BytePort | None = port
        self._reopen = reopen
        self._pending = b""
        self._fetched_ns = HostNs(0)
        self._stuck = False
        self._endings: deque[Ending] = deque()
        self._calls: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._end_at_ns: HostNs | None = None
        self._tries = 0
        self._retry_ns = HostNs(0)

    def request_end(self, ending: Ending) -> None:
        """End the run in order; from a signal handler or another thread.

        Of several the one with the gravest cause counts (:meth:`Ending.outranks`). What is asked
        of a loop that has ended comes too late: :attr:`result` tells what the device confirmed.
        """
        self._endings.append(ending)
        self._wake()

    def call(self, action: Callable[[], R]) -> Future[R]:
        """Run something in the loop's own thread, at its next turn; the answer is its result.

        An exception of the action is the answer's, not the loop's; one that is not meant for a
        user is put on record too. After the loop's end every answer is a ``DeviceLostError``.
        """
        answer: Future[R] = Future()
        self._calls.append((action, answer))
        self._wake()
        if self._over.is_set():
            self._reject_calls()
        return answer

    def wait_over(self, timeout_s: float) -> Result | None:
        """Wait until the loop has ended and its port is closed; None: it has not by then."""
        self._over.wait(timeout_s)
        return self.result

    def end_after(self, duration_s: float) -> None:
        """End the run in order after this long; not before a device was found or given up."""
        self._end_at_ns = HostNs(clock.now() + round(duration_s * 1e9))

    def run(self) -> None:
        """Loop until the run is done; the port is closed then.

        An exception anywhere in the loop ends the run as a fault: a stop is sent and repeated
        until the device has confirmed it, for a second at most. :attr:`crash` keeps it, and its
        traceback is on record. Only what is no ``Exception`` (the interpreter's own exit) is
        raised again after that.
        """
        try:
            self.host.open(clock.now())
            while not self.host.mission.done or self._endings:
                self._once()
            self._flush()
        except Exception as error:  # noqa: BLE001 - whatever it is, the robot must stop
            self._stop_after(error)
        except BaseException as error:
            self._stop_after(error)
            raise
        finally:
            self._close()

    def _close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with suppress(Exception):  # it is given up, in whatever state it is
                port.close()
        mission = self.host.mission
        ending = mission.ending or Ending("fault", "the run ended without a reason", 1)
        self.snapshot = self._last_snapshot(ending)
        self.result = Result(ending, mission.confirmed)
        self._over.set()
        self._reject_calls()
        with suppress(Exception):  # whoever still waits for an answer learns that none comes
            self.host.commands.lost()

    def _last_snapshot(self, ending: Ending) -> Snapshot:
        """The end, beside what was known last where the host can no longer tell it."""
        seen = self.snapshot
        with suppress(Exception):  # of a host that has failed, any part may
            seen = self.host.snapshot()
        return seen._replace(mission=seen.mission._replace(phase=Phase.DONE, ending=ending))

    def _wake(self) -> None:
        port = self._port
        if port is not None:
            port.wake()

    # ---- one turn -------------------------------------------------------------------------

    def _once(self) -> None:
        host = self.host
        self.turn_ns = now_ns = clock.now()
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
            self._answer_calls(now_ns)
        ending = self.watch()
        if ending is not None:
            host.end(ending, now_ns)
        while self._endings:  # after all else: a signal may come between any lines
            host.end(self._endings.popleft(), now_ns)
        if self._end_at_ns is not None and now_ns >= self._end_at_ns and host.hello is not None:
            self._end_at_ns = None
            host.end(Ending("stopped", "the time asked for is over", 0), now_ns)
        host.poll(now_ns)
        self._write(now_ns)
        if now_ns >= self._looked_ns + LOOK_PERIOD_NS or host.mission.done:
            self._looked_ns = now_ns
            self.snapshot = host.snapshot(now_ns)

    def _answer_calls(self, now_ns: HostNs) -> None:
        """Run what others asked for; what it sends leaves before they are told, and at once."""
        made: list[tuple[Future[Any], Any, Exception | None]] = []
        try:
            while self._calls:
                action, answer = self._calls.popleft()
                if not answer.set_running_or_notify_cancel():
                    continue  # nobody waits for it any more: it must not happen late
                try:
                    made.append((answer, action(), None))
                except Exception as error:  # noqa: BLE001 - it is the asker's
                    made.append((answer, None, error))
            self._write(now_ns)  # does not wait for the control step
        finally:
            for answer, result, failure in made:
                if failure is None:
                    answer.set_result(result)
                else:
                    answer.set_exception(failure)
        for _, _, failure in made:
            if failure is not None and not isinstance(failure, BridgeError):
                self._note_failure(failure, now_ns)

    def _note_failure(self, failure: Exception, now_ns: HostNs) -> None:
        text = f"a request to the run failed: {described(failure)}"
        trace = traced(failure)
        self.host.event(now_ns, Severity.ERROR, "request", EventKind.FAILED, text, traceback=trace)

    def _reject_calls(self) -> None:
        with suppress(IndexError):
            while True:
                _, answer = self._calls.popleft()
                if answer.set_running_or_notify_cancel():
                    answer.set_exception(DeviceLostError(self._ended_text()))

    def _ended_text(self) -> str:
        reason = "" if self.result is None else f": {self.result.ending.reason}"
        return f"the session has ended{reason}"

    # ---- after a crash --------------------------------------------------------------------

    def _stop_after(self, error: BaseException) -> None:
        """Stop the robot without the host, whose code has failed; then put it on record."""
        self.crash = error
        begun_ns = clock.now()
        cause, confirmed = CRASH_CAUSE, None
        if self.host.hello is not None:
            confirmed = StopCause.NONE
            end_ns = HostNs(begun_ns + CRASH_STOP_NS)
            while confirmed < (cause := self._gravest(cause)) and clock.now() < end_ns:
                confirmed = max(confirmed, self._send_stop(cause, end_ns))
        ending = crash_ending(error, cause, confirmed)
        self.host.mission.crashed(ending, confirmed or StopCause.NONE, begun_ns / 1e9)
        with suppress(Exception):  # what fails may be the record itself
            self.host.event(
                clock.now(),
                Severity.ERROR,
                "session",
                EventKind.CRASH,
                ending.reason,
                traceback=traced(error),
            )

    def _gravest(self, cause: StopCause) -> StopCause:
        """The gravest cause that has come up by now: this one, the run's, or one asked for."""
        cause = max(cause, self.host.mission.stop_cause)
        while self._endings:
            cause = max(cause, self._endings.popleft().cause)
        return cause

    def _send_stop(self, cause: StopCause, end_ns: HostNs) -> StopCause:
        """Repeat a stop until it is confirmed; gives the confirmed cause, or ``NONE``."""
        session = self.host.session
        stop = StopRequest(type(session.link), cause, new_command_id(), session.node)
        try:
            if self._port is None:
                self._port = self._reopen()
            send_until_confirmed(self._port, stop, end_ns, self._note_sent)
        except Exception:  # noqa: BLE001 - a port that has failed too is tried again
            port, self._port = self._port, None
            if port is not None:
                with suppress(Exception):
                    port.close()
            clock.pause(0.1)
        return StopCause.NONE if stop.confirmed_by is None else cause

    def _note_sent(self, data: bytes, now_ns: HostNs) -> None:
        with suppress(Exception):  # the stop matters, its record may be what has failed
            self.host.sent(data, now_ns)

    # ---- the port -------------------------------------------------------------------------

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
            self.host.event(now_ns, Severity.WARNING, "link", EventKind.STUCK, text)
        self._pending = b""

    def _flush(self) -> None:
        for _ in range(10):
            self._write(clock.now())
            if not self._pending:
                return

    def _gone(self, error: PortError, now_ns: HostNs) -> None:
        self.host.session.unplugged(now_ns)
        if self.host.session.state is not State.FAILED:  # else the reason is known, and given
            self.host.event(now_ns, Severity.ERROR, "link", EventKind.PORT_LOST, str(error))
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
        self.host.event(
            now_ns, Severity.INFO, "link", EventKind.PORT_BACK, f"{self._port.name} is back"
        )
        self.host.session.replugged(now_ns)
        self.on_reopened(self._port.name)
