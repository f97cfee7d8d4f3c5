"""The device at the other end of a pseudo-terminal (pty) for :mod:`soak.line`.

It completes the handshake, then sends as fast as the line allows.

``feeder.py SECONDS BAUD [noise]`` prints the pty's name on its first line and, at its end, how many
bytes it wrote and their CRC-32. With ``noise`` the line is full of damaged frames of 3 bytes.
"""

from __future__ import annotations

import os
import sys
import time
import tty
import zlib
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from protocol.link import Received
from protocol.messages.device import Ack, Encoders, Hello, Imu, Status, TimeReply
from protocol.messages.host import HostHello, TimeRequest
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link

PERIOD_S = 0.002
MAX_AT_ONCE = 200
"""Maximum number of frames made between two reads of the host's bytes: five times as many as the
line carries.

Without a bound, a feeder with too little processor time has more frames to make at each turn. Each
turn then takes longer than the one before. In the end the feeder sends nothing for seconds, and
the host treats the device as lost.
"""
DRAIN_S = 30.0
"""Maximum time for the host to read the remaining bytes, s. After that they are discarded."""
BITS_PER_BYTE = 10
_FRAME = 28
"""Encoded length of an inertial sample, delimiters included."""
_NOISE = b"\2\1\7\0" * (_FRAME // 4)
"""Seven damaged frames, together as long as a sample."""


class Feeder:
    """A device that sends as fast as the line allows."""

    def __init__(self, baud: int, *, noise: bool = False) -> None:
        """Open the pty and print its name."""
        self._noise = noise
        self._fd, slave = os.openpty()
        tty.setraw(self._fd)
        tty.setraw(slave)
        self._slave = slave
        os.set_blocking(self._fd, False)
        print(os.ttyname(slave), flush=True)
        self._bytes_s = baud / BITS_PER_BYTE
        self._link = Link(Direction.DEVICE)
        self._agreed = False
        self._count = 0
        self.sent = 0
        self.checksum = 0
        self._pending = b""

    def run(self, seconds: float) -> None:
        """Send for ``seconds`` after the handshake."""
        begun_s: float | None = None
        while begun_s is None or time.monotonic() - begun_s < seconds:
            now_s = time.monotonic()
            self._hear(now_s)
            if self._agreed and begun_s is None:
                begun_s = now_s
            if begun_s is not None:
                due = self._bytes_s * (now_s - begun_s) - self.sent - len(self._pending)
                # After a delay of the host, do not create all missing frames at once.
                for _ in range(min(int(due / _FRAME), MAX_AT_ONCE)):
                    self._sample(now_s)
            self._write()
            time.sleep(PERIOD_S)
        end_s = time.monotonic() + DRAIN_S
        while self._pending and time.monotonic() < end_s:
            self._write()
            time.sleep(PERIOD_S)

    def _hear(self, now_s: float) -> None:
        try:
            data = os.read(self._fd, 65536)
        except BlockingIOError:
            return
        stamp_us = int(1e6 * now_s) & 0xFFFF_FFFF
        for event in self._link.receive(data):
            if not isinstance(event, Received):
                continue
            message, _, spec = event
            if isinstance(message, HostHello):
                hello = Hello(
                    CATALOGUE.hash, bytes(12), 1, message.session_id, 0, 0, 1, 0, 0, "feeder"
                )
                self._link.send(hello, stamp_us, node=1)
                if message.negotiated:
                    self._agreed = True
                    self._link.send(Status(0, 1, 0, 0, 5), stamp_us, node=1)
            elif isinstance(message, TimeRequest):
                self._link.send(TimeReply(message.ping, stamp_us), stamp_us, node=1)
            elif hasattr(message, "command_id"):
                self._link.send(Ack(message.command_id, spec.type_id), stamp_us, node=1)
        self._pending += self._link.data_to_send()

    def _sample(self, now_s: float) -> None:
        self._count += 1
        value = self._count & 0x7FFF
        stamp_us = int(1e6 * now_s) & 0xFFFF_FFFF
        if self._noise:
            self._pending += _NOISE
        else:
            self._link.send(Imu(value, 1, 16384, 0, 0, 0, 0), stamp_us, node=1)
        if self._count % 200 == 0:
            self._link.send(Encoders(value, value), stamp_us, node=1)
            self._link.send(Status(0, 1, 0, 0, 5), stamp_us, node=1)
        self._pending += self._link.data_to_send()

    def _write(self) -> None:
        if not self._pending:
            return
        try:
            taken = os.write(self._fd, self._pending)
        except BlockingIOError:
            return
        self.checksum = zlib.crc32(self._pending[:taken], self.checksum)
        self.sent += taken
        self._pending = self._pending[taken:]


def main() -> None:
    """Feed, then print the number of bytes written."""
    feeder = Feeder(int(sys.argv[2]), noise="noise" in sys.argv[3:])
    feeder.run(float(sys.argv[1]))
    time.sleep(5.0)  # bytes in the pseudo-terminal must be read before it closes
    print(feeder.sent, feeder.checksum)


if __name__ == "__main__":
    main()
