"""A TCP connection as pyserial has it, whatever the number of its descriptor."""

from __future__ import annotations

from serial.urlhandler import protocol_socket

SCHEME = "socket://"


class TcpPort(protocol_socket.Serial):
    """pyserial's ``socket://``, opened without ``select``, which takes 1024 descriptors."""

    def reset_input_buffer(self) -> None:
        """Keep what came: a new connection has nothing old, and pyserial selects on it."""
