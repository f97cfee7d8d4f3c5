"""The monitor's table in windows of several sizes: it may truncate values, but never names."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from bridge.session.monitor import Monitor
from protocol.clock import HostNs
from protocol.messages.device import Encoders, Imu, PlannerState, Power, Range, Status
from protocol.schema.message import Direction
from protocol.uart.link import Link
from tools.live.monitor_view import RateTable

SENT = (
    Encoders(100, 200),
    Imu(1234, -4321, 16384, 999, -31, 77, 131),
    Range(1234, 80, 255, 1, 30),
    PlannerState(1, 2, 1200, -300, 160, 160, 40, 1),
    Power(15_500, 200, 3, 4),
    Status(1, 4, 1 << 6, 0, 7),
)
NAMES = ("encoders", "imu", "range", "power", "status", "planner_state")


@pytest.mark.parametrize(("width", "height"), [(120, 50), (60, 20), (60, 13), (50, 12)])
def test_every_type_is_there_with_its_rate(width: int, height: int) -> None:
    monitor, line = Monitor(), Link(Direction.DEVICE)
    for turn in range(4):
        for message in SENT:
            line.send(message, 1000 * turn, node=1)
        monitor.receive(line.data_to_send() + b"\1\2\3\0", HostNs(10**9 * (turn + 1)))
    table = RateTable(monitor, "/dev/ttyUSB0[x]", ())
    out = io.StringIO()
    console = Console(file=out, width=width, height=height, force_terminal=True, color_system=None)
    console.print(table.picture(console))
    lines = out.getvalue().splitlines()
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    for name in NAMES:
        (row,) = [line for line in lines if f"{name} " in line]
        assert row.replace("│", " ").split()[:2] == [name, "device"]
        assert row.replace("│", " ").split()[3] == "4", "number of messages"
    text = "\n".join(lines)
    assert "/dev/ttyUSB0[x]" in text
    assert "newest damaged" in text
    assert lines[-1] == "Ctrl-C: end"
