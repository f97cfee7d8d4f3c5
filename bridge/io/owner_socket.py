"""Unix socket of a port's owner, for requests of the same user's other processes.

A request and its answer are one line of JSON each; docs/owner-socket.md has the protocol. The
socket has mode 0600 in a folder with mode 0700. On Linux the kernel reports the client's user. A
stop is always accepted. One thread accepts clients and reads their requests, and never waits for a
client. Other threads send the answers. Their number is limited, but a stop is not counted. If there
are too many clients, a new client replaces a client without a request.
"""

from __future__ import annotations

import errno
import itertools
import json
import os
import select
import selectors
import socket
import struct
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, Protocol, Self

from bridge.errors import BridgeError
from bridge.io.owner_names import folder, link_names, put_link, sweep

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from types import TracebackType

MAX_LINE = 4096
"""Maximum length of a request with its line end, bytes."""
MAX_CLIENTS = 128
"""Maximum number of connections. A further connection closes the oldest connection without a
request."""
MAX_ANSWERS = 8
"""Maximum number of concurrent answers; stops are not counted. Each answer may wait 8 s for the
device."""
MAX_VIEWERS = 8
"""Maximum number of clients that watch the status."""
MIN_HZ, MAX_HZ = 0.01, 50.0
"""Limits of a viewer's status rate, Hz."""
MAX_QUEUED = 64
"""Maximum number of queued requests of a client. Further requests are not read."""
IDLE_S = 30.0
"""Maximum time without a request before a client is disconnected, s."""
SEND_S = 2.0
"""Maximum time for a client to read an answer, s."""
FINISH_S = 2.0
"""Maximum time to finish answers at the owner's end, s."""
_BACKLOG = 1024
"""Maximum number of connections that wait for acceptance; the kernel may allow fewer."""
_READ_SIZE = 4 * MAX_LINE
"""Maximum number of bytes of one read. Most lines that are too long fit in one read, so that the
disconnection does not discard earlier answers."""
_TICK_S = 0.25
"""Interval of the checks for idle clients and the end, s."""
_CREDENTIALS = struct.Struct("3i")
"""Linux' struct ucred: process, user and group id."""
_CROWDED = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})
"""Errors of ``accept`` when the system has no free descriptor or memory."""
_numbers = itertools.count()


class Service(Protocol):
    """Executes requests, in the threads of the socket."""

    def answer(self, request: dict[str, Any], requester: str) -> dict[str, Any]:
        """Execute a request; return its answer.

        Raises:
            BridgeError: the request failed; the client receives the text.

        """

    def snapshot(self) -> dict[str, Any]:
        """Return the robot's current state."""

    def dashboard(self) -> dict[str, Any]:
        """Return all variable data of a dashboard."""

    @property
    def over(self) -> bool:
        """True if the run has ended."""


class _Work(Enum):
    """Task of a thread for a client."""

    STOP = "stop"
    ANSWER = "answer"
    REJECT = "reject"
    VIEW = "view"


@dataclass(slots=True, eq=False)
class _Client:
    """A connection. Only the reading thread uses it, except for sending with ``lock``."""

    sock: socket.socket
    who: str
    """Description of the client's process."""
    since_s: float
    """Time of the connection or of the last request."""
    unread: bytes = b""
    requests: deque[dict[str, Any] | None] = field(default_factory=deque)
    """Unanswered requests in order; None: an invalid line."""
    has_asked: bool = False
    is_open: bool = True
    """True if the client may send more requests."""
    is_read: bool = True
    """True if the reading thread reads from the client; False while too many requests are
    queued."""
    answers: int = 0
    """Number of threads that answer the client."""
    in_order: bool = False
    """True while one thread answers the queued requests in order."""
    lock: threading.Lock = field(default_factory=threading.Lock)
    """Lock that a thread holds while it sends a line."""


class OwnerSocket:
    """Accepts requests until it is closed."""

    def __init__(self, port: str, service: Service) -> None:
        """Listen under the port's names.

        Raises:
            BridgeError: the system has no Unix sockets, or no private folder exists for the
                socket.

        """
        if not hasattr(socket, "AF_UNIX"):
            raise BridgeError("other processes cannot reach this run: it has no Unix sockets")
        self._service = service
        self._folder = folder()
        sweep(self._folder)
        self.path = self._folder / f"{os.getpid()}-{next(_numbers)}.sock"
        self._names: list[str] = []
        self._clients: dict[int, _Client] = {}
        """Clients by descriptor; used by the reading thread only."""
        self._viewers = 0
        """Number of viewers; used by the reading thread only."""
        self._answering = 0
        """Number of requests being answered; guarded by ``_lock``."""
        self._threads: set[threading.Thread] = set()
        self._done: deque[tuple[_Client, _Work]] = deque()
        """Clients for which a thread has ended, with the thread's task."""
        self._lock = threading.Lock()
        """Lock for the set of threads and the number of answers."""
        self._closed = threading.Event()
        self._listener = socket.socket(socket.AF_UNIX)
        try:
            _bind(self._listener, self.path)
            self.also(port)
        except OSError as error:
            self._listener.close()
            raise BridgeError(f"cannot listen on {self.path}: {error.strerror}") from None
        self._listener.listen(_BACKLOG)
        self._listener.setblocking(False)  # noqa: FBT003 - the library's interface
        self._wake_read, self._wake_write = socket.socketpair()
        self._wake_read.setblocking(False)  # noqa: FBT003 - as above
        self._wake_write.setblocking(False)  # noqa: FBT003 - as above
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._wake_read, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._run, name="owner", daemon=True)
        self._thread.start()

    def also(self, port: str) -> None:
        """Add links for this port's names, after the port was reopened under another path."""
        for name in link_names(port):
            put_link(self._folder, name, self.path)
            if name not in self._names:
                self._names.append(name)

    def close(self) -> None:
        """Finish open answers, disconnect all clients and remove the links."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._wake()
        self._thread.join()
        deadline_s = time.monotonic() + FINISH_S
        with self._lock:
            threads = list(self._threads)
        for thread in threads:
            thread.join(max(0.0, deadline_s - time.monotonic()))
        for client in self._clients.values():
            client.sock.close()
        self._selector.close()
        for end in (self._listener, self._wake_read, self._wake_write):
            end.close()
        for name in self._names:
            with suppress(OSError):
                if (self._folder / name).readlink().name == self.path.name:
                    (self._folder / name).unlink()
        with suppress(OSError):
            self.path.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    # ---- reading thread: it never waits for a client ----------------------------------------

    def _wake(self) -> None:
        with suppress(OSError):
            self._wake_write.send(b"!")

    def _run(self) -> None:
        idle_s = time.monotonic() + _TICK_S
        while not self._closed.is_set():
            ready = {key.fd for key, _ in self._selector.select(_TICK_S)}
            if self._wake_read.fileno() in ready:
                with suppress(OSError):
                    self._wake_read.recv(4096)
            self._serve_done()
            for client in [self._clients[fd] for fd in ready if fd in self._clients]:
                if client.sock.fileno() in ready:  # not disconnected in this pass
                    self._receive(client)
            if self._listener.fileno() in ready:
                self._accept()  # one per pass, because connected clients have priority
            if time.monotonic() >= idle_s:
                idle_s = time.monotonic() + _TICK_S
                self._hang_up_on_idle()

    def _accept(self) -> None:
        try:
            sock, _ = self._listener.accept()
        except OSError as error:
            if error.errno in _CROWDED and not self._give_way():
                self._closed.wait(0.01)  # no descriptor left, and no client to close
            return
        sock.setblocking(False)  # noqa: FBT003 - the library's interface
        if len(self._clients) >= MAX_CLIENTS:
            self._give_way()
        who = _peer(sock)
        client = _Client(sock, who or "", time.monotonic())
        if who is None:
            self._send_answer(
                client, {"ok": False, "error": "only the owner's own user may send requests"}, 0.0
            )
            sock.close()
            return
        self._clients[sock.fileno()] = client
        self._selector.register(sock, selectors.EVENT_READ)
        self._receive(client)  # most clients have already sent

    def _give_way(self) -> bool:
        """Disconnect the client with the longest idle time.

        Return False if there is no idle client.
        """
        idle = [c for c in self._clients.values() if not c.answers]
        if not idle:
            return False
        client = min(idle, key=lambda c: (c.has_asked, c.since_s))
        text = "too many clients are connected, and this one sent no request"
        self._send_answer(client, {"ok": False, "error": text}, 0.0)
        self._drop(client)
        return True

    def _hang_up_on_idle(self) -> None:
        now_s = time.monotonic()
        for client in list(self._clients.values()):
            if not client.answers and now_s - client.since_s > IDLE_S:
                self._drop(client)

    def _drop(self, client: _Client) -> None:
        self._clients.pop(client.sock.fileno(), None)
        client.is_open = False
        self._listen_to(client, more=False)
        client.sock.close()

    def _listen_to(self, client: _Client, *, more: bool) -> None:
        if more == client.is_read:
            return
        client.is_read = more
        if more:
            self._selector.register(client.sock, selectors.EVENT_READ)
        else:
            self._selector.unregister(client.sock)

    def _receive(self, client: _Client) -> None:
        """Read and serve a client's requests; disconnect the client on an internal error."""
        try:
            self._read(client)
            self._serve_next(client)
        except Exception:  # noqa: BLE001 - no client may end the thread that accepts a stop
            self._drop(client)

    def _read(self, client: _Client) -> None:
        try:
            data = client.sock.recv(_READ_SIZE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        client.is_open = bool(data)
        *lines, client.unread = (client.unread + data).split(b"\n")
        for line in lines:
            if len(line) < MAX_LINE:
                self._take(client, line)
            else:
                client.is_open = False
        client.is_open = client.is_open and len(client.unread) < MAX_LINE

    def _take(self, client: _Client, line: bytes) -> None:
        client.since_s, client.has_asked = time.monotonic(), True
        try:
            request = json.loads(line)
        except (ValueError, RecursionError):
            request = None
        if isinstance(request, dict) and request.get("do") == "stop":
            # A stop is executed before other requests of this client, and is not counted.
            self._begin(client, _Work.STOP, lambda: self._answer(client, request))
        else:
            client.requests.append(request if isinstance(request, dict) else None)

    def _serve_done(self) -> None:
        """Continue with the clients to which an answer was sent."""
        with suppress(IndexError):
            while True:
                client, kind = self._done.popleft()
                self._ended(client, kind)
                self._serve_next(client)

    def _serve_next(self, client: _Client) -> None:
        """Answer a client's next request if no answer is in progress."""
        if client.sock.fileno() < 0:
            return  # disconnected
        while client.requests and not client.in_order:
            self._next(client, client.requests.popleft())
        if not client.is_open and not client.answers and not client.requests:
            self._drop(client)
        else:
            self._listen_to(client, more=client.is_open and len(client.requests) < MAX_QUEUED)

    def _next(self, client: _Client, request: dict[str, Any] | None) -> None:
        """Start to answer a request."""
        client.in_order = True
        if request is None:
            self._reject(client, "a request must be one line with one JSON object")
        elif request.get("do") == "watch":
            self._watch(client, request)
        elif not self._count_in():
            text = f"{MAX_ANSWERS} requests are in progress; try again"
            self._reject(client, text)
        else:
            self._begin(client, _Work.ANSWER, lambda: self._answer_counted(client, request))

    def _watch(self, client: _Client, request: dict[str, Any]) -> None:
        """Start to send the status."""
        hz, of = request.get("hz", 4.0), request.get("of", "status")
        shown = {"status": self._service.snapshot, "dashboard": self._service.dashboard}
        if isinstance(hz, bool) or not isinstance(hz, int | float) or not MIN_HZ <= hz <= MAX_HZ:
            self._reject(client, f"hz is not in {MIN_HZ:g} to {MAX_HZ:g}")
        elif not isinstance(of, str) or of not in shown:
            self._reject(client, f"of is not one of {', '.join(shown)}")
        elif self._viewers >= MAX_VIEWERS:
            self._reject(client, f"{MAX_VIEWERS} viewers are connected; try again")
        else:
            self._viewers += 1
            look = _looked(of, shown[of])
            self._begin(client, _Work.VIEW, lambda: self._stream(client, 1.0 / hz, look))

    def _reject(self, client: _Client, text: str) -> None:
        answer = {"ok": False, "error": text}
        self._begin(client, _Work.REJECT, lambda: self._send_answer(client, answer, SEND_S))

    def _begin(self, client: _Client, kind: _Work, work: Callable[[], object]) -> None:
        """Run ``work`` in a new thread."""
        client.answers += 1

        def run() -> None:
            try:
                work()
            finally:
                with self._lock:
                    self._threads.discard(thread)
                self._done.append((client, kind))
                self._wake()

        thread = threading.Thread(target=run, name="owner-answer", daemon=True)
        with self._lock:
            self._threads.add(thread)
        try:
            thread.start()
        except RuntimeError:  # no more threads
            if kind is _Work.STOP:
                run()  # in this thread: a stop must not wait
                return
            with self._lock:
                self._threads.discard(thread)
            if kind is _Work.ANSWER:
                self._count_out()
            client.is_open = False
            client.requests.clear()
            self._done.append((client, kind))

    def _ended(self, client: _Client, kind: _Work) -> None:
        """Undo the counting of :meth:`_begin`."""
        client.answers -= 1
        client.in_order = client.in_order and kind is _Work.STOP
        self._viewers -= kind is _Work.VIEW

    # ---- answering threads ------------------------------------------------------------------

    def _count_in(self) -> bool:
        """Count a request as in progress; return False if there are too many."""
        with self._lock:
            if self._answering >= MAX_ANSWERS:
                return False
            self._answering += 1
        return True

    def _count_out(self) -> None:
        with self._lock:
            self._answering -= 1

    def _answer(self, client: _Client, request: dict[str, Any]) -> None:
        self._send_answer(client, self._answer_to(client, request), SEND_S)

    def _answer_counted(self, client: _Client, request: dict[str, Any]) -> None:
        try:
            answer = self._answer_to(client, request)
        finally:
            self._count_out()  # before sending: the client may send again at once
        self._send_answer(client, answer, SEND_S)

    def _answer_to(self, client: _Client, request: dict[str, Any]) -> dict[str, Any]:
        try:
            return {"ok": True, **self._service.answer(request, client.who)}
        except BridgeError as error:
            return {"ok": False, "error": error.bare, "exit_status": error.exit_status}
        except Exception as error:  # noqa: BLE001 - reported to the client
            return {"ok": False, "error": _internal(error), "exit_status": 1}

    def _stream(self, client: _Client, period_s: float, look: Callable[[], dict[str, Any]]) -> None:
        try:
            while not self._closed.is_set():
                over = self._service.over
                answer = look()
                if not self._send_answer(client, answer, SEND_S) or over or not answer["ok"]:
                    return
                if not self._wait(client, period_s):
                    break
            if self._closed.is_set():  # send the final status
                self._send_answer(client, look(), SEND_S)
        finally:
            with suppress(OSError):
                client.sock.shutdown(socket.SHUT_RDWR)

    def _wait(self, client: _Client, period_s: float) -> bool:
        """Wait for a viewer's period; return False if the viewer disconnected or the owner ends."""
        hung_up = select.poll()
        hung_up.register(client.sock, 0)  # a hang-up is always reported
        end_s = time.monotonic() + period_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            if hung_up.poll(min(left_s, _TICK_S) * 1000.0) or self._closed.is_set():
                return False
        return True

    @staticmethod
    def _send_answer(client: _Client, answer: dict[str, Any], within_s: float) -> bool:
        """Send a line; return False if the client does not read it within this time."""
        rest = json.dumps(answer).encode() + b"\n"
        end_s = time.monotonic() + within_s
        if not client.lock.acquire(timeout=within_s):
            return False  # the client does not read the previous answer
        try:
            while True:
                with suppress(BlockingIOError):
                    rest = rest[client.sock.send(rest) :]
                if not rest:
                    return True
                left_s = end_s - time.monotonic()
                if left_s <= 0.0:
                    client.sock.shutdown(socket.SHUT_RDWR)  # no partial answers
                    return False
                taking = select.poll()
                taking.register(client.sock, select.POLLOUT)
                taking.poll(left_s * 1000.0)
        except OSError:
            return False  # disconnected
        finally:
            client.lock.release()


def _looked(name: str, look: Callable[[], dict[str, Any]]) -> Callable[[], dict[str, Any]]:
    """Return a function that creates a viewer's next answer."""

    def answer() -> dict[str, Any]:
        try:
            return {"ok": True, name: look()}
        except Exception as error:  # noqa: BLE001 - reported to the client
            return {"ok": False, "error": _internal(error), "exit_status": 1}

    return answer


def _internal(error: Exception) -> str:
    return f"internal error: {type(error).__name__}"


def _bind(listener: socket.socket, path: Path) -> None:
    before = os.umask(0o177)
    try:
        listener.bind(str(path))
    finally:
        os.umask(before)


def _peer(client: socket.socket) -> str | None:
    """Return the client's process as text; None for another user's process (root is allowed)."""
    if sys.platform != "linux":
        return "another process"
    raw = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, _ = _CREDENTIALS.unpack(raw)
    return f"process {pid}" if uid in {0, os.getuid()} else None
