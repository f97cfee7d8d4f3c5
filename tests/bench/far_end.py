"""The other end of a pseudo-terminal for the round-trip benchmark: an echo, or a small device.

Run in a separate process: ``far_end.py echo:SIZE:ANSWER`` or ``far_end.py device``.
"""

from __future__ import annotations

import fcntl
import os
import struct
import sys
from contextlib import suppress
from pathlib import Path

import serial

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from protocol.link import Received
from protocol.messages.device import Ack, Hello, Sync, TimeReply
from protocol.messages.host import HostHello, TimeRequest
from protocol.schema.catalogue import CATALOGUE
from protocol.schema.message import Direction
from protocol.uart.link import Link

TIOCSPTLCK, TIOCGPTN = 0x4004_5431, 0x8004_5430
"""Linux ioctl numbers: unlock a pseudo-terminal's slave; read its number."""


def pty_master() -> serial.Serial:
    """Open a new pseudo-terminal's master with pyserial; print its slave on stdout."""
    master = serial.Serial("/dev/ptmx", 921_600)
    fcntl.ioctl(master.fileno(), TIOCSPTLCK, struct.pack("i", 0))
    (number,) = struct.unpack("i", fcntl.ioctl(master.fileno(), TIOCGPTN, bytes(4)))
    print(f"/dev/pts/{number}", flush=True)
    return master


def echo(size: int, answer: int) -> None:
    """Answer each ``size`` bytes with ``answer`` bytes, in the simplest way with pyserial."""
    port = pty_master()
    reply = bytes(answer)
    while port.read(size):
        port.write(reply)


def device() -> None:
    """Acknowledge every command."""
    port = pty_master()
    fd = port.fileno()
    os.set_blocking(fd, True)
    link, session = Link(Direction.DEVICE), 0
    while data := os.read(fd, 4096):
        for event in link.receive(data):
            if not isinstance(event, Received):
                continue
            message, frame, spec = event
            if isinstance(message, HostHello):
                session = message.session_id
                hello = Hello(CATALOGUE.hash, bytes(12), 1, session, 0, 0, 0, 1, 0, "far end")
                link.send(hello, 0, node=1)
                if message.negotiated:
                    link.send(Sync(1), 0, node=1)
            elif isinstance(message, TimeRequest):
                link.send(TimeReply(message.ping, frame.t_us), frame.t_us, node=1)
            elif hasattr(message, "command_id"):
                link.send(Ack(message.command_id, spec.type_id), frame.t_us, node=1)
        if link.has_data:
            os.write(fd, link.data_to_send())


if __name__ == "__main__":
    kind, _, sizes = sys.argv[1].partition(":")
    with suppress(OSError):  # the benchmark has closed its end
        if kind == "echo":
            echo(*map(int, sizes.split(":")))
        else:
            device()
