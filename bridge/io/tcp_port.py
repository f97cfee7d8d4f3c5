"""TCP port through pyserial, for file descriptors with any number."""

from __future__ import annotations

from serial.urlhandler import protocol_socket

SCHEME = "socket://"


class TcpPort(protocol_socket.Serial):
    """pyserial's ``socket://`` without ``select``, which supports descriptors below 1024 only."""

    def reset_input_buffer(self) -> None:
        """Do nothing: a new connection has no old bytes, and pyserial would call select."""
