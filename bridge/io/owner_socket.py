"""The Unix socket of a port's owner: other processes of the same user ask it things.

One request is one line of JSON, one answer one line of JSON; docs/owner-socket.md is the whole
protocol. The socket has mode 0600, lies in a folder of mode 0700, and the far end's user is
asked of the kernel where it tells.
"""

from __future__ import annotations

import itertools
import json
import os
import socket
import struct
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Protocol, Self

from bridge.errors import BridgeError
from bridge.io.owner_names import folder, link_names, put_link, sweep

if TYPE_CHECKING:
    from pathlib import Path
    from types import TracebackType

MAX_LINE = 4096
MAX_CLIENTS = 8
MAX_HZ = 50.0
IDLE_S = 30.0
"""A client that asks nothing for so long is hung up on."""
LAST_WORDS_S = 2.0
"""For answers that are under way as the owner ends."""
_CREDENTIALS = struct.Struct("3i")
_numbers = itertools.count()


class Service(Protocol):
    """What answers; asked from the socket's own threads."""

    def answer(self, request: dict[str, Any], asker: str) -> dict[str, Any]:
        """Do what a request asks for.

        Raises:
            BridgeError: it cannot be done; told to the asker.

        """

    def snapshot(self) -> dict[str, Any]:
        """What is known of the robot now."""

    @property
    def over(self) -> bool:
        """True when there is nothing more to see."""


class OwnerSocket:
    """Listens for as long as it is open; every client has a thread of its own."""

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
        self._clients: dict[socket.socket, threading.Thread] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._listener = socket.socket(socket.AF_UNIX)
        try:
            _bind(self._listener, self.path)
            self.also(port)
        except OSError as error:
            self._listener.close()
            raise BridgeError(f"cannot listen on {self.path}: {error.strerror}") from None
        self._listener.listen(MAX_CLIENTS)
        self._thread = threading.Thread(target=self._listen, name="owner", daemon=True)
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
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join()
        with self._lock:
            clients = dict(self._clients)
        for client in clients:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RD)  # what is being answered still gets out
        deadline_s = time.monotonic() + LAST_WORDS_S
        for thread in clients.values():
            thread.join(max(0.0, deadline_s - time.monotonic()))
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

    # ---- its threads ----------------------------------------------------------------------

    def _listen(self) -> None:
        while not self._closed.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                self._closed.wait(0.05)  # ended, or out of file descriptors for a while
                continue
            with self._lock:
                crowded = len(self._clients) >= MAX_CLIENTS
                if not crowded and not self._closed.is_set():
                    thread = threading.Thread(
                        target=self._serve, args=(client,), name="owner-client", daemon=True
                    )
                    self._clients[client] = thread
                    thread.start()
                    continue
            with client, suppress(OSError):
                _say(client, {"ok": False, "error": f"{MAX_CLIENTS} clients are connected already"})

    def _serve(self, client: socket.socket) -> None:
        try:
            client.settimeout(IDLE_S)
            who = _peer(client)
            if who is None:
                _say(client, {"ok": False, "error": "only the owner's own user may ask"})
                return
            with client.makefile("rb") as lines:
                while line := lines.readline(MAX_LINE + 1):
                    if len(line) > MAX_LINE or not self._answer(client, line, who):
                        return
        except OSError:
            pass  # it has left, or does not read: its loss
        finally:
            client.close()
            with self._lock:
                self._clients.pop(client, None)

    def _answer(self, client: socket.socket, line: bytes, who: str) -> bool:
        try:
            request = json.loads(line)
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict):
            _say(client, {"ok": False, "error": "a request is a line with one JSON object"})
            return True
        if request.get("do") == "watch":
            self._stream(client, request)
            return False
        try:
            _say(client, {"ok": True, **self._service.answer(request, who)})
        except BridgeError as error:
            refusal = {"ok": False, "error": str(error), "exit_status": error.exit_status}
            _say(client, refusal)
        return True

    def _stream(self, client: socket.socket, request: dict[str, Any]) -> None:
        hz = request.get("hz", 4.0)
        if not isinstance(hz, int | float) or isinstance(hz, bool) or not 0.0 < hz <= MAX_HZ:
            _say(client, {"ok": False, "error": f"hz is not in 0 to {MAX_HZ:g}"})
            return
        client.settimeout(1.0)  # a viewer that does not read is none
        while not self._closed.is_set():
            over = self._service.over
            _say(client, {"ok": True, "status": self._service.snapshot()})
            if over:
                return
            self._closed.wait(1.0 / hz)


def _bind(listener: socket.socket, path: Path) -> None:
    before = os.umask(0o177)
    try:
        listener.bind(str(path))
    finally:
        os.umask(before)


def _say(client: socket.socket, answer: dict[str, Any]) -> None:
    client.sendall(json.dumps(answer).encode() + b"\n")


def _peer(client: socket.socket) -> str | None:
    """Who asks, in words; None for another user's process (root may ask)."""
    if sys.platform != "linux":
        return "another process"
    raw = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, _ = _CREDENTIALS.unpack(raw)
    return f"process {pid}" if uid in {0, os.getuid()} else None
