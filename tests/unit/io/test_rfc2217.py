"""``rfc2217://``: a serial port of another computer, against pyserial's own port server."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from typing import Any

import pytest
import serial
from serial.rfc2217 import PortManager

from bridge.io.ports import SerialPort


class Server:
    """A port server for one client, in front of a port that returns its bytes."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"rfc2217://127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        client, _ = self._listener.accept()
        self._listener.close()
        client.settimeout(0.01)
        loop = serial.serial_for_url("loop://", timeout=0)
        manager: Any = PortManager(loop, Connection(client))  # type: ignore[arg-type]  # has all that is used
        with client, contextlib.suppress(OSError):
            while True:
                with contextlib.suppress(TimeoutError):
                    data = client.recv(1024)
                    if not data:
                        return
                    loop.write(b"".join(manager.filter(data)))
                if loop.in_waiting:
                    client.sendall(b"".join(manager.escape(loop.read(loop.in_waiting))))

    def close(self) -> None:
        self._thread.join(5.0)
        assert not self._thread.is_alive()


class Connection:
    """What ``PortManager`` writes its answers to."""

    def __init__(self, client: socket.socket) -> None:
        self._client = client

    def write(self, data: bytes) -> None:
        self._client.sendall(data)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # pyserial's setDaemon
def test_bytes_go_to_the_server_and_back() -> None:
    server = Server()
    with SerialPort(server.url, baud=115_200) as port:
        sent = bytes(range(256))
        assert port.write(sent) == len(sent)
        came, end_s = b"", time.monotonic() + 10.0
        while len(came) < len(sent) and time.monotonic() < end_s:
            came += port.wait(0.1)
        assert came == sent
    server.close()
