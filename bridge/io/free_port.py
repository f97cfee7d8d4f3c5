"""Search for a free TCP port on the loopback interface."""

from __future__ import annotations

import socket


def free_tcp_port() -> int:
    """Return a port number that is free now. Another process may take it at any time."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
