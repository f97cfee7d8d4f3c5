"""``connect --on`` with a robot on a real pty: a failing command, a lost device, a normal end."""

from __future__ import annotations

import json
import signal
from typing import TYPE_CHECKING, Any

import pytest

from bridge.record.reader import LogReader
from bridge.session.event_kinds import EventKind
from support.two_processes import Command, Emulator, connect
from support.waiting import until

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.realtime


def event_in(path: Path) -> dict[str, Any]:
    """Wait until a command has written its event; return the event."""
    until(lambda: path.exists() and path.read_text().endswith("}\n"), what=path.name)
    event = json.loads(path.read_text())
    assert isinstance(event, dict)
    return event


def test_a_failing_command_is_logged_and_the_run_continues(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with Emulator(tmp_path, "--fault", "battery-flat@1") as device:
        failing = ("--on", "battery-low", "sleep 0.5; echo no broker >&2; exit 4")
        done = connect(tmp_path, device.port, "--duration", "4", "--json", "--out", log, *failing)
    assert done.status == 0, done.err
    assert done.json["outcome"] == "stopped"
    kinds = {}
    for message in LogReader(log).messages(["/events"]):
        event = message.decoded
        kinds[event.source, event.kind] = event.text
    assert "exit status 4: no broker" in kinds["on", EventKind.COMMAND_FAILED]
    assert "exit status 4: no broker" in done.err


def test_a_killed_device_and_the_end_are_events(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    with Emulator(tmp_path) as device:
        words = (
            *("connect", device.port, "--out", log, "--json"),
            *("--on", "device-lost", "cat > lost.json"),
            *("--on", "finished", "cat > end.json"),
        )
        with Command(*words, cwd=tmp_path) as host:
            host.prints("ready")
            device.send(signal.SIGKILL)
            lost = event_in(tmp_path / "lost.json")
            host.send(signal.SIGTERM)
            done = host.end()
    assert (lost["event"], lost["port"], lost["log"]) == ("device-lost", device.port, str(log))
    end = event_in(tmp_path / "end.json")
    assert end["exit_status"] == done.status
    assert end["summary"] == done.json
    assert not LogReader(log).truncated, "the log was complete when the command ran"
