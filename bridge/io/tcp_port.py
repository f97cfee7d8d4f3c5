"""TCP port through pyserial, for descriptors of any number."""

from __future__ import annotations

from serial.urlhandler import protocol_socket

SCHEME = "socket://"


class TcpPort(protocol_socket.Serial):
    """pyserial's ``socket://`` without its ``select``, which supports 1024 descriptors."""

    def reset_input_buffer(self) -> None:
        """Do nothing: a new connection has no old bytes, and pyserial would call select."""
