"""Connection from a run to the live server: a bounded queue for the server's process."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import subprocess
import sys
import threading
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

from bridge.view.errors import FoxgloveMissingError, FoxgloveServerError
from bridge.view.foxglove.frames import FrameKind, PipeFrame

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_QUEUED = 64
"""Maximum number of queued chunks. They are 16 s of a run in real time, and at most 16 MiB."""
_START_S = 20.0
"""Maximum time for the start of the server, s."""
_END_S = 0.5
"""Maximum time for sending the queued chunks at the end of a run, s."""


_STOP_S = 1.0
"""Maximum time for the server to send its last messages and to end, s."""


class _Item:
    """A chunk in the queue, with the frames that must reach the server before it."""

    __slots__ = ("before", "chunk", "messages")

    def __init__(self, before: list[PipeFrame], chunk: bytes, messages: int) -> None:
        self.before = before
        """Frames that are never dropped: new files and declarations."""
        self.chunk = chunk
        """Record of the chunk; empty: the item has only frames."""
        self.messages = messages


class FoxglovePublisher:
    """Sends the chunks of a log to a Foxglove server in its own process.

    It is a :class:`bridge.record.chunked_file.ChunkTap`. :meth:`take` never waits. If the server is
    too slow, the oldest chunks are dropped and counted.
    """

    def __init__(self, host: str, port: int, parameters: Mapping[str, object]) -> None:
        """Start the server and wait until it listens.

        Args:
            host: address to listen on.
            port: TCP port; 0: any free port.
            parameters: parameters of the run that clients can read.

        Raises:
            FoxgloveMissingError: foxglove-sdk is not installed.
            FoxgloveServerError: the server cannot listen on the address.

        """
        check()
        root = str(Path(__file__).parents[3])
        paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(  # noqa: S603 - this program
            [sys.executable, "-P", "-m", "bridge.view.foxglove.server", host, str(port)],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C ends the run, and the run ends the server
        )
        self.port = self._started(host, port)
        """TCP port on which the server listens."""
        shown = f"[{host}]" if ":" in host else host
        self.address = f"ws://{shown}:{self.port}"
        """Address for Foxglove."""
        self.dropped = 0
        """Number of messages that were dropped."""
        self._before: list[PipeFrame] = []
        first = PipeFrame(FrameKind.PARAMETERS, json.dumps(parameters, default=str).encode())
        self._items = deque([_Item([first], b"", 0)])
        self._changed = threading.Condition()
        self._closing = False
        self._thread = threading.Thread(target=self._send, name="foxglove", daemon=True)
        self._thread.start()

    @property
    def pid(self) -> int:
        """Process id of the server."""
        return self._process.pid

    def begin(self) -> None:
        """Report that a log file begins."""
        self._before.append(PipeFrame(FrameKind.FILE))

    def take(self, declarations: bytes, chunk: bytes, messages: int) -> None:
        """Queue a chunk; drop the oldest chunk if there are too many."""
        if declarations:
            self._before.append(PipeFrame(FrameKind.RECORDS, declarations))
        item = _Item(self._before, chunk, messages)
        self._before = []
        with self._changed:
            self._items.append(item)
            if len(self._items) > MAX_QUEUED:
                oldest = self._items.popleft()
                self.dropped += oldest.messages
                following = self._items[0]
                count = PipeFrame(FrameKind.DROPPED, str(self.dropped).encode())
                kept = [each for each in oldest.before if each.kind is not FrameKind.DROPPED]
                following.before = [*kept, *following.before, count]
            self._changed.notify()

    def close(self) -> None:
        """End the server within 2 s. If the server is too slow, the rest of its queue is lost."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(_END_S)
        if self._thread.is_alive():
            with self._changed:
                self.dropped += sum(item.messages for item in self._items)
                self._items.clear()
            self._process.kill()  # also ends a blocked write
            self._thread.join(_END_S)
        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()  # type: ignore[union-attr]  # it is a pipe

    def _started(self, host: str, port: int) -> int:
        """Return the port, which the server prints in its first line."""
        timer = threading.Timer(_START_S, self._process.kill)
        timer.daemon = True
        timer.start()
        line = self._process.stdout.readline().decode()  # type: ignore[union-attr]  # it is a pipe
        timer.cancel()
        word, _, rest = line.strip().partition(" ")
        if word == "ready":
            return int(rest)
        self._process.kill()
        self._process.communicate()
        raise FoxgloveServerError(host, port, rest or "it could not be started")

    def _send(self) -> None:
        """Write the queue to the server's standard input, which may block. End with the queue."""
        stream = self._process.stdin
        assert stream is not None  # noqa: S101 - it is a pipe
        with contextlib.suppress(OSError, ValueError):  # the server was killed
            while True:
                with self._changed:
                    while not self._items and not self._closing:
                        self._changed.wait()
                    if not self._items:
                        break
                    item = self._items.popleft()
                for frame in item.before:
                    stream.write(frame.to_bytes())
                if item.chunk:
                    stream.write(PipeFrame(FrameKind.RECORDS, item.chunk).to_bytes())
                stream.flush()
        with contextlib.suppress(OSError):
            stream.close()


def check() -> None:
    """Check that the server can be started.

    Raises:
        FoxgloveMissingError: foxglove-sdk is not installed.

    """
    if importlib.util.find_spec("foxglove") is None:
        raise FoxgloveMissingError
