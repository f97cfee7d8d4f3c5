"""A chip with a firmware library, driven over two pipes by :mod:`sim_device.ports.core_process`.

Started as ``python -m sim_device.core.child LIBRARY``. Requests arrive on stdin and replies leave
on stdout; what the library itself prints on stdout goes to stderr. A message has a head of five
bytes (kind and length) and a payload.
"""

from __future__ import annotations

import os
import struct
import sys
from pathlib import Path

from sim_device.core.chip import LibraryError, LocalChip, catch_signals

HEAD = struct.Struct("<BI")
"""Kind or operation, length of what follows."""
OPENED, REJECTED, REPLY, ASKED, ANSWER = 64, 65, 66, 67, 68
"""Kinds of messages beside a chip's operations."""
REJECTED_STATUS = 3
"""Exit status where the library does not load."""


class Pipes:
    """Whole messages over two file descriptors."""

    def __init__(self, reading: int, writing: int) -> None:
        self._reading, self._writing = reading, writing

    def write(self, kind: int, payload: bytes) -> None:
        """Send one."""
        data = HEAD.pack(kind, len(payload)) + payload
        sent = os.write(self._writing, data)
        while sent < len(data):
            sent += os.write(self._writing, data[sent:])

    def read(self) -> tuple[int, bytes]:
        """Wait for one.

        Raises:
            EOFError: the other end is gone.

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
    """Do what is asked until the other end is gone; exit status."""
    pipes = Pipes(os.dup(0), os.dup(1))
    os.dup2(2, 1)

    def ask(what: int) -> bytes:
        pipes.write(ASKED, bytes((what,)))
        return pipes.read()[1]

    catch_signals()
    try:
        chip = LocalChip(ask, library)
    except LibraryError as error:
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
