"""Child process that runs a firmware library; the parent controls it over two pipes.

:mod:`sim_device.ports.core_process` starts it as ``python -m sim_device.core.child LIBRARY``. The
process reads requests from stdin and writes replies to stdout. Output that the library itself
writes to stdout is redirected to stderr. A message has a header of five bytes (kind and length) and
a payload.
"""

from __future__ import annotations

import os
import struct
import sys
from pathlib import Path

from sim_device.core.chip import FirmwareLibraryError, LocalChip, catch_signals

HEAD = struct.Struct("<BI")
"""Header of a message: kind or operation, and length of the payload."""
OPENED, REJECTED, REPLY, ASKED, ANSWER = 64, 65, 66, 67, 68
"""Kinds of messages in addition to the operations of a chip
(:class:`sim_device.core.chip.Operation`)."""
REJECTED_STATUS = 3
"""Exit status if the library cannot be loaded."""


class Pipes:
    """Reads and writes complete messages over two file descriptors."""

    def __init__(self, reading: int, writing: int) -> None:
        self._reading, self._writing = reading, writing

    def write(self, kind: int, payload: bytes) -> None:
        """Send one message."""
        data = HEAD.pack(kind, len(payload)) + payload
        sent = os.write(self._writing, data)
        while sent < len(data):
            sent += os.write(self._writing, data[sent:])

    def read(self) -> tuple[int, bytes]:
        """Wait for one message.

        Raises:
            EOFError: the peer has closed its end.

        """
        head = self._exactly(HEAD.size)
        kind, length = HEAD.unpack(head)
        return kind, self._exactly(length) if length else b""

    def _exactly(self, length: int) -> bytes:
        data = os.read(self._reading, length)
        while len(data) < length:
            more = os.read(self._reading, length - len(data))
            if not more:
                raise EOFError
            data += more
        return data


def serve(library: Path) -> int:
    """Serve requests until the peer has closed its end; return the exit status."""
    pipes = Pipes(os.dup(0), os.dup(1))
    os.dup2(2, 1)

    def ask(what: int) -> bytes:
        pipes.write(ASKED, bytes((what,)))
        return pipes.read()[1]

    catch_signals()
    try:
        chip = LocalChip(ask, library)
    except FirmwareLibraryError as error:
        pipes.write(REJECTED, error.reason.encode())
        return REJECTED_STATUS
    pipes.write(OPENED, chip.imu_settings)
    while True:
        try:
            operation, payload = pipes.read()
        except EOFError:
            return 0
        pipes.write(REPLY, chip.call(operation, payload))


if __name__ == "__main__":
    sys.exit(serve(Path(sys.argv[1])))
