"""The emulator's control socket: idle clients do not block other clients."""

from __future__ import annotations

import json
import select
import socket
from contextlib import ExitStack
from typing import TYPE_CHECKING

from sim_device.ports import ControlServer
from support.rigs import rig

if TYPE_CHECKING:
    from pathlib import Path

PATIENCE_S = 30.0


def test_idle_clients_take_nobodys_place(tmp_path: Path) -> None:
    path, made = tmp_path / "control", rig()
    server = ControlServer(path)

    def turn() -> None:
        assert select.select(server.filenos(), [], [], PATIENCE_S)[0]
        server.turn(made)

    with ExitStack() as stack:
        stack.callback(server.close)
        clients = []
        for _ in range(20):
            client = stack.enter_context(socket.socket(socket.AF_UNIX))
            client.connect(str(path))
            clients.append(client)
            turn()
        for client in (clients[-1], clients[-3]):
            client.sendall(b"line\n")
            turn()
            client.settimeout(PATIENCE_S)
            assert json.loads(client.recv(65_536))["ok"]
        assert clients[0].recv(1) == b"", "the server closes the longest-idle client"
