"""The Unix socket of a port's owner: other processes of the same user ask it things.

One request is one line of JSON, one answer one line of JSON; docs/owner-socket.md is the whole
protocol. The socket has mode 0600, lies in a folder of mode 0700, and the far end's user is
asked of the kernel where it tells.

A stop is always accepted. One thread accepts and reads, and never waits for a client; answers
have threads of their own, of which a stop needs none of the counted ones. Where too many clients
are connected, one that has asked for nothing gives way to the newest.
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
"""Length of a request with its line end, bytes."""
MAX_CLIENTS = 128
"""Connections that are open at once; a new one closes the oldest that has asked for nothing."""
MAX_ANSWERS = 8
"""Requests that are answered at once, stops not counted: each may wait for the device for 8 s."""
MAX_VIEWERS = 8
"""Clients that watch at once."""
MIN_HZ, MAX_HZ = 0.01, 50.0
"""Rates at which a viewer gets the status, Hz."""
MAX_QUEUED = 64
"""Requests of one client that wait for the one before, at most; more are not read yet."""
IDLE_S = 30.0
"""A client that asks nothing for so long is hung up on."""
SEND_S = 2.0
"""Time that a client has to take an answer, seconds; one that does not read is none."""
LAST_WORDS_S = 2.0
"""For answers that are under way as the owner ends."""
_BACKLOG = 1024
"""Connections that wait to be accepted; the kernel may allow fewer."""
_READ_SIZE = 4 * MAX_LINE
"""Bytes that are read of a client at once: a line that is too long is mostly read whole, so that
hanging up does not take away the answers before it."""
_TICK_S = 0.25
_CREDENTIALS = struct.Struct("3i")
_CROWDED = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})
_numbers = itertools.count()


class Service(Protocol):
    """What answers; asked from the socket's own threads."""

    def answer(self, request: dict[str, Any], requester: str) -> dict[str, Any]:
        """Do what a request asks for.

        Raises:
            BridgeError: it cannot be done; told to the asker.

        """

    def snapshot(self) -> dict[str, Any]:
        """What is known of the robot now."""

    @property
    def over(self) -> bool:
        """True when there is nothing more to see."""


class _Work(Enum):
    """What a thread does for a client."""

    STOP = "stop"
    ANSWER = "answer"
    REJECT = "refuse"
    VIEW = "view"


@dataclass(slots=True, eq=False)
class _Client:
    """One connection; the reading thread's, but for what ``lock`` guards."""

    sock: socket.socket
    who: str
    """The process at the other end, in words."""
    since_s: float
    """When it connected, or asked last."""
    unread: bytes = b""
    requests: deque[dict[str, Any] | None] = field(default_factory=deque)
    """Read and not answered yet, in order; None: a line that is no request."""
    has_asked: bool = False
    is_open: bool = True
    """More may come from it."""
    is_read: bool = True
    """The reading thread listens to it; not where it has sent more than is answered."""
    answers: int = 0
    """Threads that answer it now."""
    in_order: bool = False
    """One of them answers its requests in their order."""
    lock: threading.Lock = field(default_factory=threading.Lock)
    """Held while a line is sent to it."""


class OwnerSocket:
    """Listens for as long as it is open."""

    def __init__(self, port: str, service: Service) -> None:
        """Listen under the port's names.

        Raises:
            BridgeError: there are no Unix sockets here, or no safe folder for one.

        """
        if not hasattr(socket, "AF_UNIX"):
            raise BridgeError("other shells cannot reach this run: no Unix sockets here")
        self._service = service
        self._folder = folder()
        sweep(self._folder)
        self.path = self._folder / f"{os.getpid()}-{next(_numbers)}.sock"
        self._names: list[str] = []
        self._clients: dict[int, _Client] = {}
        """By the descriptor's number; the reading thread's own."""
        self._viewers = 0
        """Counted by the reading thread."""
        self._answering = 0
        """Requests that are answered now; ``_lock`` guards it."""
        self._threads: set[threading.Thread] = set()
        self._done: deque[tuple[_Client, _Work]] = deque()
        """Clients for which a thread has ended, and what it did."""
        self._lock = threading.Lock()
        """Guards the set of threads, and the count of answers."""
        self._closed = threading.Event()
        self._listener = socket.socket(socket.AF_UNIX)
        try:
            _bind(self._listener, self.path)
            self.also(port)
        except OSError as error:
            self._listener.close()
            raise BridgeError(f"cannot listen on {self.path}: {error.strerror}") from None
        self._listener.listen(_BACKLOG)
        self._listener.setblocking(False)  # noqa: FBT003 - the library's own interface
        self._wake_read, self._wake_write = socket.socketpair()
        self._wake_read.setblocking(False)  # noqa: FBT003 - as above
        self._wake_write.setblocking(False)  # noqa: FBT003 - as above
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._wake_read, selectors.EVENT_READ)
        self._thread = threading.Thread(target=self._run, name="owner", daemon=True)
        self._thread.start()

    def also(self, port: str) -> None:
        """Be found under this port's names too: it came back under another path."""
        for name in link_names(port):
            put_link(self._folder, name, self.path)
            if name not in self._names:
                self._names.append(name)

    def close(self) -> None:
        """Finish the answers under way, hang up, and take the names away."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._wake()
        self._thread.join()
        deadline_s = time.monotonic() + LAST_WORDS_S
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

    # ---- the reading thread: it waits for nobody -------------------------------------------

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
                if client.sock.fileno() in ready:  # it was not hung up on meanwhile
                    self._hear(client)
            if self._listener.fileno() in ready:
                self._accept()  # one at a time: who is connected already is heard before
            if time.monotonic() >= idle_s:
                idle_s = time.monotonic() + _TICK_S
                self._hang_up_on_idle()

    def _accept(self) -> None:
        try:
            sock, _ = self._listener.accept()
        except OSError as error:
            if error.errno in _CROWDED and not self._give_way():
                self._closed.wait(0.01)  # out of descriptors, and none of them is ours to close
            return
        sock.setblocking(False)  # noqa: FBT003 - the library's own interface
        if len(self._clients) >= MAX_CLIENTS:
            self._give_way()
        who = _peer(sock)
        client = _Client(sock, who or "", time.monotonic())
        if who is None:
            self._send_answer(
                client, {"ok": False, "error": "only the owner's own user may ask"}, 0.0
            )
            sock.close()
            return
        self._clients[sock.fileno()] = client
        self._selector.register(sock, selectors.EVENT_READ)
        self._hear(client)  # most have written by now

    def _give_way(self) -> bool:
        """Hang up on the client that has waited longest without a request; False: none has."""
        idle = [c for c in self._clients.values() if not c.answers]
        if not idle:
            return False
        client = min(idle, key=lambda c: (c.has_asked, c.since_s))
        text = "too many clients are connected, and this one had nothing to ask"
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

    def _hear(self, client: _Client) -> None:
        """Read what a client has written; a client that breaks something here is hung up on."""
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
            # At once, whatever else this client waits for, and beside the counted answers.
            self._begin(client, _Work.STOP, lambda: self._answer(client, request))
        else:
            client.requests.append(request if isinstance(request, dict) else None)

    def _serve_done(self) -> None:
        """Go on with the clients whose answers have gone out."""
        with suppress(IndexError):
            while True:
                client, kind = self._done.popleft()
                self._ended(client, kind)
                self._serve_next(client)

    def _serve_next(self, client: _Client) -> None:
        """Answer what a client has asked, as far as no answer of it is under way."""
        if client.sock.fileno() < 0:
            return  # hung up on
        while client.requests and not client.in_order:
            self._next(client, client.requests.popleft())
        if not client.is_open and not client.answers and not client.requests:
            self._drop(client)
        else:
            self._listen_to(client, more=client.is_open and len(client.requests) < MAX_QUEUED)

    def _next(self, client: _Client, request: dict[str, Any] | None) -> None:
        """Begin to answer a request."""
        client.in_order = True
        if request is None:
            self._reject(client, "a request is a line with one JSON object")
        elif request.get("do") == "watch":
            self._watch(client, request)
        elif not self._count_in():
            text = f"{MAX_ANSWERS} requests are being answered already; ask again"
            self._reject(client, text)
        else:
            self._begin(client, _Work.ANSWER, lambda: self._answer_counted(client, request))

    def _watch(self, client: _Client, request: dict[str, Any]) -> None:
        """Begin to show the status."""
        hz = request.get("hz", 4.0)
        if isinstance(hz, bool) or not isinstance(hz, int | float) or not MIN_HZ <= hz <= MAX_HZ:
            self._reject(client, f"hz is not in {MIN_HZ:g} to {MAX_HZ:g}")
        elif self._viewers >= MAX_VIEWERS:
            self._reject(client, f"{MAX_VIEWERS} viewers are connected already")
        else:
            self._viewers += 1
            self._begin(client, _Work.VIEW, lambda: self._stream(client, 1.0 / hz))

    def _reject(self, client: _Client, text: str) -> None:
        answer = {"ok": False, "error": text}
        self._begin(client, _Work.REJECT, lambda: self._send_answer(client, answer, SEND_S))

    def _begin(self, client: _Client, kind: _Work, work: Callable[[], object]) -> None:
        """Have something done in a thread of its own."""
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
        except RuntimeError:  # the system gives no more threads
            if kind is _Work.STOP:
                run()  # here, then: whatever else waits for it, a stop must not
                return
            with self._lock:
                self._threads.discard(thread)
            if kind is _Work.ANSWER:
                self._count_out()
            client.is_open = False
            client.requests.clear()
            self._done.append((client, kind))

    def _ended(self, client: _Client, kind: _Work) -> None:
        """Count down what was counted up as the work began."""
        client.answers -= 1
        client.in_order = client.in_order and kind is _Work.STOP
        self._viewers -= kind is _Work.VIEW

    # ---- the answering threads --------------------------------------------------------------

    def _count_in(self) -> bool:
        """Count a request as being answered; False where there are enough."""
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
            self._count_out()  # first: who has the answer may ask again at once
        self._send_answer(client, answer, SEND_S)

    def _answer_to(self, client: _Client, request: dict[str, Any]) -> dict[str, Any]:
        try:
            return {"ok": True, **self._service.answer(request, client.who)}
        except BridgeError as error:
            return {"ok": False, "error": error.bare, "exit_status": error.exit_status}
        except Exception as error:  # noqa: BLE001 - a defect of ours: the asker learns of it
            text = f"internal error: {type(error).__name__}"
            return {"ok": False, "error": text, "exit_status": 1}

    def _stream(self, client: _Client, period_s: float) -> None:
        try:
            while not self._closed.is_set():
                over = self._service.over
                answer = {"ok": True, "status": self._service.snapshot()}
                if not self._send_answer(client, answer, SEND_S) or over:
                    return
                if not self._wait(client, period_s):
                    break
            if self._closed.is_set():  # the end of the run is worth a last line
                self._send_answer(client, {"ok": True, "status": self._service.snapshot()}, SEND_S)
        finally:
            with suppress(OSError):
                client.sock.shutdown(socket.SHUT_RDWR)

    def _wait(self, client: _Client, period_s: float) -> bool:
        """Let a viewer's period pass; False where it has hung up, or the owner ends."""
        hung_up = select.poll()
        hung_up.register(client.sock, 0)  # a hang-up is told unasked
        end_s = time.monotonic() + period_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            if hung_up.poll(min(left_s, _TICK_S) * 1000.0) or self._closed.is_set():
                return False
        return True

    @staticmethod
    def _send_answer(client: _Client, answer: dict[str, Any], within_s: float) -> bool:
        """Send a line; False where the client does not take it within this time."""
        rest = json.dumps(answer).encode() + b"\n"
        end_s = time.monotonic() + within_s
        if not client.lock.acquire(timeout=within_s):
            return False  # it does not even take the answer before this one
        try:
            while True:
                with suppress(BlockingIOError):
                    rest = rest[client.sock.send(rest) :]
                if not rest:
                    return True
                left_s = end_s - time.monotonic()
                if left_s <= 0.0:
                    client.sock.shutdown(socket.SHUT_RDWR)  # half an answer is none
                    return False
                taking = select.poll()
                taking.register(client.sock, select.POLLOUT)
                taking.poll(left_s * 1000.0)
        except OSError:
            return False  # it has left
        finally:
            client.lock.release()


def _bind(listener: socket.socket, path: Path) -> None:
    before = os.umask(0o177)
    try:
        listener.bind(str(path))
    finally:
        os.umask(before)


def _peer(client: socket.socket) -> str | None:
    """Who asks, in words; None for another user's process (root may ask)."""
    if sys.platform != "linux":
        return "another process"
    raw = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, _ = _CREDENTIALS.unpack(raw)
    return f"process {pid}" if uid in {0, os.getuid()} else None
