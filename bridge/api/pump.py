"""The loop that owns a port: reads bytes, handles timers, writes bytes and reopens the port."""

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
from bridge.session.backoff import backoff_ns
from bridge.session.event_kinds import EventKind
from bridge.session.records import Severity
from bridge.session.states import State
from bridge.session.stop_request import stop_request
from protocol.clock import HostNs
from protocol.messages.values import StopCause

if TYPE_CHECKING:
    from collections.abc import Callable

    from bridge.io.ports import BytePort
    from bridge.run.host import Host
    from bridge.run.snapshot import Snapshot

_IDLE_S = 0.25
"""Maximum wait for bytes in one pass, s."""
STUCK_NS = 50_000_000
"""Maximum age of unsent bytes, ns. The loop drops older bytes and records an event."""
CRASH_STOP_NS = 1_000_000_000
"""Maximum time for which a failed loop repeats its stop, ns. A clean end has the same limit."""
LOOK_PERIOD_NS = 2_000_000
"""Minimum interval of snapshots for other threads, ns. A snapshot takes 10 µs, and a link at 3
Mbaud wakes the loop a thousand times per second."""
R = TypeVar("R")


class LoopResult(NamedTuple):
    """Result of a loop; created once, when its port is closed."""

    ending: Ending
    confirmed: StopCause
    """Highest cause of the stops that the device confirmed; ``NONE``: no stop confirmed."""


class Pump:
    """Runs a host on a port until its run has ended.

    The host belongs to the loop's thread. Other threads may request an end (:meth:`request_end`),
    run an action in the loop (:meth:`call`) and read :attr:`snapshot` and :attr:`result`.
    """

    def __init__(self, host: Host, port: BytePort, reopen: Callable[[], BytePort]) -> None:
        """Create a loop; ``reopen`` opens the same device again after a loss of its port."""
        self.host = host
        self.watch: Callable[[], Ending | None] = lambda: None
        """Function that is called in every pass. It returns an end that another part of the program
        requests, or None."""
        self.on_reopened: Callable[[str], None] = lambda _name: None
        """Function that is called with the name of a port that was reopened."""
        self.crash: BaseException | None = None
        """Exception that ended the loop; None: no exception."""
        self.result: LoopResult | None = None
        """Result of the loop; None: the loop has not ended."""
        self.snapshot = host.snapshot()
        """Newest state of the robot and its run, for any thread."""
        self._looked_ns = 0
        self.turn_ns = clock.now()
        """Start time of the newest pass. It is old if the loop does not respond."""
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
        """Request a clean end of the run, from a signal handler or another thread.

        If several ends are requested, the highest cause counts (:meth:`Ending.outranks`). A request
        after the loop's end has no effect; :attr:`result` has the confirmed stop.
        """
        self._endings.append(ending)
        self._wake()

    def call(self, action: Callable[[], R]) -> Future[R]:
        """Run ``action`` in the loop's next pass and return a future of its result.

        The future gets the exception of an action. An exception other than a ``BridgeError`` is
        also recorded. After the loop's end every future gets a ``DeviceLostError``.
        """
        answer: Future[R] = Future()
        self._calls.append((action, answer))
        self._wake()
        if self._over.is_set():
            self._reject_calls()
        return answer

    def wait_over(self, timeout_s: float) -> LoopResult | None:
        """Wait until the loop has ended and its port is closed; None after a timeout."""
        self._over.wait(timeout_s)
        return self.result

    def end_after(self, duration_s: float) -> None:
        """End the run after ``duration_s``, but not before the search for a device has ended."""
        self._end_at_ns = HostNs(clock.now() + round(duration_s * 1e9))

    def run(self) -> None:
        """Run the loop until the run has ended, then close the port.

        An exception in the loop ends the run as a fault. A stop is sent and repeated until the
        device confirms it, for 1 s at most. :attr:`crash` contains the exception, and the log
        contains its traceback. An exception that is not an :class:`Exception`
        (``KeyboardInterrupt``, ``SystemExit``) is raised again.
        """
        try:
            self.host.open(clock.now())
            while not self.host.mission.done or self._endings:
                self._once()
            self._flush()
        except Exception as error:  # noqa: BLE001 - the robot must stop after any exception
            self._stop_after(error)
        except BaseException as error:
            self._stop_after(error)
            raise
        finally:
            self._close()

    def _close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with suppress(Exception):  # the port may have failed
                port.close()
        mission = self.host.mission
        ending = mission.ending or Ending("fault", "the run ended without a reason", 1)
        self.snapshot = self._last_snapshot(ending)
        self.result = LoopResult(ending, mission.confirmed)
        self._over.set()
        self._reject_calls()
        with suppress(Exception):  # ends the commands that still wait
            self.host.commands.lost()

    def _last_snapshot(self, ending: Ending) -> Snapshot:
        """Return the final snapshot, with the last known state if the host has failed."""
        seen = self.snapshot
        with suppress(Exception):  # any part of a failed host may raise
            seen = self.host.snapshot()
        return seen._replace(mission=seen.mission._replace(phase=Phase.DONE, ending=ending))

    def _wake(self) -> None:
        port = self._port
        if port is not None:
            port.wake()

    # ---- one pass ---------------------------------------------------------------------------

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
        while self._endings:  # last, because a signal may occur between any lines
            host.end(self._endings.popleft(), now_ns)
        if self._end_at_ns is not None and now_ns >= self._end_at_ns and host.hello is not None:
            self._end_at_ns = None
            host.end(Ending("stopped", "the requested duration is over", 0), now_ns)
        host.poll(now_ns)
        self._write(now_ns)
        if now_ns >= self._looked_ns + LOOK_PERIOD_NS or host.mission.done:
            self._looked_ns = now_ns
            self.snapshot = host.snapshot(now_ns)

    def _answer_calls(self, now_ns: HostNs) -> None:
        """Run the queued actions. Their bytes are sent before their results are set."""
        made: list[tuple[Future[Any], Any, Exception | None]] = []
        try:
            while self._calls:
                action, answer = self._calls.popleft()
                if not answer.set_running_or_notify_cancel():
                    continue  # the caller no longer waits, so it must not run
                try:
                    made.append((answer, action(), None))
                except Exception as error:  # noqa: BLE001 - the caller gets it
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
        """Stop the robot without the failed host, then record the crash."""
        self.crash = error
        begun_ns = clock.now()
        cause, confirmed = CRASH_CAUSE, None
        if self.host.hello is not None:
            confirmed = StopCause.NONE
            end_ns = HostNs(begun_ns + CRASH_STOP_NS)
            while confirmed < (cause := self._highest_cause(cause)) and clock.now() < end_ns:
                confirmed = max(confirmed, self._send_stop(cause, end_ns))
        ending = crash_ending(error, cause, confirmed)
        self.host.mission.crashed(ending, confirmed or StopCause.NONE, begun_ns / 1e9)
        with suppress(Exception):  # the record itself may have failed
            self.host.event(
                clock.now(),
                Severity.ERROR,
                "session",
                EventKind.CRASH,
                ending.reason,
                traceback=traced(error),
            )

    def _highest_cause(self, cause: StopCause) -> StopCause:
        """Return the highest cause so far: ``cause``, the run's cause, or a requested cause."""
        cause = max(cause, self.host.mission.stop_cause)
        while self._endings:
            cause = max(cause, self._endings.popleft().cause)
        return cause

    def _send_stop(self, cause: StopCause, end_ns: HostNs) -> StopCause:
        """Repeat a stop until it is confirmed; return the confirmed cause or ``NONE``."""
        session = self.host.session
        stop = stop_request(type(session.link), cause, new_command_id(), session.node)
        try:
            if self._port is None:
                self._port = self._reopen()
            send_until_confirmed(self._port, stop, end_ns, self._note_sent)
        except Exception:  # noqa: BLE001 - a failed port is opened again
            port, self._port = self._port, None
            if port is not None:
                with suppress(Exception):
                    port.close()
            clock.pause(0.1)
        return StopCause.NONE if stop.confirmed_by is None else cause

    def _note_sent(self, data: bytes, now_ns: HostNs) -> None:
        with suppress(Exception):  # the record may have failed; the stop matters
            self.host.sent(data, now_ns)

    # ---- the port -------------------------------------------------------------------------

    def _write(self, now_ns: HostNs) -> None:
        # New bytes are fetched only after the old bytes are written. Newer messages can still
        # replace messages in the link's queue, but not bytes here.
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
        self.host.sent(fresh, now_ns)  # recorded after writing, to save latency

    def _drop_stuck(self, now_ns: HostNs) -> None:
        # Each batch starts with a delimiter, so the receiver loses only the truncated frame. The
        # session repeats stops and commands.
        if not self._stuck:
            self._stuck = True
            text = f"the port accepts no bytes; {len(self._pending)} bytes were dropped"
            self.host.event(now_ns, Severity.WARNING, "link", EventKind.STUCK, text)
        self._pending = b""

    def _flush(self) -> None:
        for _ in range(10):
            self._write(clock.now())
            if not self._pending:
                return

    def _gone(self, error: PortError, now_ns: HostNs) -> None:
        self.host.session.unplugged(now_ns)
        if self.host.session.state is not State.FAILED:  # otherwise the reason is already recorded
            self.host.event(now_ns, Severity.ERROR, "link", EventKind.PORT_LOST, str(error))
        if self._port is not None:
            self._port.close()
        self._port = None
        self._pending = b""
        self._tries = 0
        self._retry_ns = HostNs(now_ns + backoff_ns(0))

    def _try_reopen(self, now_ns: HostNs) -> None:
        if now_ns < self._retry_ns:
            clock.pause(min(_IDLE_S, (self._retry_ns - now_ns) / 1e9, 0.02))
            return
        try:
            self._port = self._reopen()
        except PortError:
            self._tries += 1
            self._retry_ns = HostNs(now_ns + backoff_ns(self._tries))
            return
        self.host.event(
            now_ns, Severity.INFO, "link", EventKind.PORT_BACK, f"{self._port.name} is back"
        )
        self.host.session.replugged(now_ns)
        self.on_reopened(self._port.name)
